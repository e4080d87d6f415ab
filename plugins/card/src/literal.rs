//! A processor that runs the text of the kernels. Tests of everything but the card itself use it.

use crate::backend::Backend;
use plan::cuda::Batch;
use plan::cuda::literal::Literal;
use plan::executor::Lost;
use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;
use std::path::PathBuf;

/// States in memory, and a program for each routine.
#[derive(Debug)]
pub struct LiteralProcessor {
    /// Folder of the programs.
    folder: PathBuf,
    programs: BTreeMap<usize, Literal>,
    /// States of each cohort, and their size.
    states: BTreeMap<usize, (usize, Vec<f32>)>,
    /// Outputs of batches that were not waited for yet.
    outputs: VecDeque<Vec<f32>>,
}

impl LiteralProcessor {
    /// A processor with its programs in an existing folder.
    #[must_use]
    pub fn new(folder: PathBuf) -> Self {
        Self {
            folder,
            programs: BTreeMap::new(),
            states: BTreeMap::new(),
            outputs: VecDeque::new(),
        }
    }

    fn state(&mut self, cohort: usize, member: u32) -> &mut [f32] {
        let (size, states) = self.states.entry(cohort).or_default();
        &mut states[member as usize * *size..][..*size]
    }
}

fn lost(error: &std::io::Error) -> Lost {
    Lost {
        reason: error.to_string(),
    }
}

impl Backend for LiteralProcessor {
    fn reserve(&mut self, cohort: usize, state_size: usize, n_members: usize) -> Result<(), Lost> {
        let (size, states) = self.states.entry(cohort).or_default();
        *size = state_size;
        // Results must not depend on unwritten entries, so these get an extreme value.
        states.resize(n_members * state_size, f32::MAX);
        Ok(())
    }

    fn write(&mut self, cohort: usize, member: u32, first: usize, entries: &[f32]) -> Result<(), Lost> {
        self.state(cohort, member)[first..][..entries.len()].copy_from_slice(entries);
        Ok(())
    }

    fn read(&mut self, cohort: usize, member: u32, entries: Range<usize>) -> Result<Vec<f32>, Lost> {
        Ok(self.state(cohort, member)[entries].to_vec())
    }

    fn start(&mut self, cohort: usize, routine: usize, batch: &Batch<'_>) -> Result<(), Lost> {
        if !self.programs.contains_key(&routine) {
            let program = self.folder.join(format!("routine-{routine}"));
            let compiled = Literal::new(batch.kernels, &program).map_err(|error| lost(&error))?;
            self.programs.insert(routine, compiled);
        }
        let states = &mut self.states.entry(cohort).or_default().1;
        let outputs = self.programs[&routine].run(states, batch);
        self.outputs.push_back(outputs.map_err(|error| lost(&error))?);
        Ok(())
    }

    fn finish(&mut self) -> Result<Vec<f32>, Lost> {
        // A batch is begun before it is finished.
        Ok(self.outputs.pop_front().unwrap_or_default())
    }
}
