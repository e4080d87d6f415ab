//! The kernels of a routine run literally on the processor, for tests: the same text, compiled by the C compiler, one
//! block and one thread after the other.

use super::Kernels;
use crate::state::State;
use std::collections::BTreeMap;
use std::io::{Error, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// A member of a population.
#[derive(Debug, Clone, Default)]
pub struct Member {
    /// Parameters, moments and counts.
    pub state: State<f32>,
    /// Entries of inputs by name; others are 0.
    pub inputs: BTreeMap<String, Vec<f32>>,
    /// Entries of outputs by name, after a run.
    pub outputs: BTreeMap<String, Vec<f32>>,
    /// Seed of the next run.
    pub seed: u64,
}

/// A compiled program.
#[derive(Debug)]
pub struct Literal {
    kernels: Kernels,
    program: PathBuf,
}

impl Literal {
    /// Compiles the kernels in a folder that is there.
    ///
    /// # Errors
    /// [`Error`] where no compiler `cc` is found, or it fails.
    pub fn new(kernels: Kernels, folder: &Path) -> Result<Self, Error> {
        let program = folder.join("kernels");
        let source = folder.join("kernels.c");
        std::fs::write(&source, kernels.host_program())?;
        let mut compiler = Command::new("cc");
        compiler.args(["-std=gnu11", "-O1", "-ffp-contract=off", "-w", "-o"]);
        let done = compiler.arg(&program).arg(&source).arg("-lm").output()?;
        if !done.status.success() {
            return Err(Error::other(String::from_utf8_lossy(&done.stderr).into_owned()));
        }
        Ok(Self { kernels, program })
    }

    /// Runs the routine for the members at given places in memory, in this order.
    ///
    /// # Errors
    /// [`Error`] where the program fails.
    pub fn run(&self, members: &mut [Member], places: &[usize]) -> Result<(), Error> {
        let kernels = &self.kernels;
        let mut runs = Vec::new();
        for place in places {
            let Member { state, seed, .. } = &mut members[*place];
            runs.extend(kernels.prepare(state, *seed));
        }
        let (tensors, state_size) = kernels.state_layout();
        let mut words: Vec<u32> = vec![count(members.len()), count(state_size)];
        words.extend(tensors.iter().map(|first| count(*first)));
        words.extend(kernels.constants().iter().map(|entry| entry.to_bits()));
        for member in &mut *members {
            // Members that do not run have no moments yet.
            kernels.add_moments(&mut member.state);
            words.extend(
                kernels
                    .state_entries(&member.state)
                    .iter()
                    .map(|entry| entry.to_bits()),
            );
        }
        for member in &*members {
            words.extend(self.values(member).iter().map(|entry| entry.to_bits()));
        }
        words.push(count(places.len()));
        words.extend(places.iter().map(|place| count(*place)));
        words.extend(runs);
        let after = self.call(&words)?;
        let (states, values) = after.split_at(members.len() * state_size);
        for (place, member) in members.iter_mut().enumerate() {
            if places.contains(&place) {
                kernels.take_entries(&mut member.state, &states[place * state_size..][..state_size]);
            }
            let own = &values[place * kernels.value_size()..];
            for span in kernels.outputs() {
                let entries = own[span.first..][..span.length].to_vec();
                member.outputs.insert(span.name.clone(), entries);
            }
        }
        Ok(())
    }

    /// Values of a member before a run: inputs, and numbers in all other places, which no result may depend on.
    fn values(&self, member: &Member) -> Vec<f32> {
        let mut values = vec![-7.5e33; self.kernels.value_size()];
        for span in self.kernels.inputs() {
            let own = &mut values[span.first..][..span.length];
            match member.inputs.get(&span.name) {
                Some(entries) => own.copy_from_slice(entries),
                None => own.fill(0.0),
            }
        }
        values
    }

    fn call(&self, words: &[u32]) -> Result<Vec<f32>, Error> {
        let mut command = Command::new(&self.program);
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let (input, output) = (child.stdin.take(), child.stdout.take());
        // The program reads everything before it writes.
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        input.ok_or_else(|| Error::other("no input"))?.write_all(&bytes)?;
        let mut after = Vec::new();
        output
            .ok_or_else(|| Error::other("no output"))?
            .read_to_end(&mut after)?;
        let status = child.wait()?;
        if !status.success() {
            return Err(Error::other(format!("the program ended with {status}")));
        }
        let words = after.as_chunks::<4>().0.iter();
        Ok(words.map(|word| f32::from_le_bytes(*word)).collect())
    }
}

/// A number below 2^32 of members or entries.
fn count(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}
