//! Runs the kernels of a routine literally on the processor, for tests: the same text, compiled by a C++ compiler, one
//! block and one thread after the other.

use super::{Batch, Kernels};
use std::io::{Error, Read, Write};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// C++ compiler.
pub const COMPILER: &str = "c++";

/// Whether [`COMPILER`] is on the path.
#[must_use]
pub fn has_compiler() -> bool {
    let asked = Command::new(COMPILER).arg("--version").output();
    asked.is_ok_and(|answer| answer.status.success())
}

/// A compiled program.
#[derive(Debug)]
pub struct Literal {
    program: PathBuf,
}

impl Literal {
    /// Compiles the kernels to a file that does not exist yet.
    ///
    /// # Errors
    /// [`Error`] if no [`COMPILER`] is found, or it fails.
    pub fn new(kernels: &Kernels, program: &Path) -> Result<Self, Error> {
        let source = program.with_extension("cpp");
        std::fs::write(&source, kernels.host_program())?;
        let mut compiler = apart(COMPILER.as_ref());
        compiler.args(["-std=c++17", "-O1", "-ffp-contract=off", "-w", "-o"]);
        let done = compiler.arg(program).arg(&source).arg("-lm").output()?;
        if done.status.success() {
            Ok(Self {
                program: program.to_owned(),
            })
        } else {
            Err(Error::other(String::from_utf8_lossy(&done.stderr).into_owned()))
        }
    }

    /// Runs the routine; `states` contains those of all members, one after the other. Returns the outputs of each run.
    ///
    /// # Errors
    /// [`Error`] if the program fails.
    pub fn run(&self, states: &mut [f32], batch: &Batch<'_>) -> Result<Vec<f32>, Error> {
        let n_members = states.len().checked_div(batch.state_size).unwrap_or(0);
        let counts = [n_members, batch.state_size, batch.members.len()].map(count);
        let words = counts
            .iter()
            .chain(batch.tensors)
            .chain(&batch.kernels.constants)
            .copied()
            .chain(states.iter().map(|entry| entry.to_bits()))
            .chain(std::iter::once(count(batch.members.len())))
            .chain(batch.members.iter().copied())
            .chain(batch.runs.iter().copied().flatten().copied())
            .chain(
                batch
                    .inputs
                    .iter()
                    .copied()
                    .flatten()
                    .map(|entry| entry.to_bits()),
            );
        let after = self.call(&words.flat_map(u32::to_le_bytes).collect::<Vec<u8>>())?;
        let (changed, outputs) = after.split_at(states.len());
        states.copy_from_slice(changed);
        Ok(outputs.to_vec())
    }

    fn call(&self, input: &[u8]) -> Result<Vec<f32>, Error> {
        let mut command = apart(&self.program);
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let (to, from) = (child.stdin.take(), child.stdout.take());
        // The program reads everything before it writes.
        to.ok_or_else(|| Error::other("no input"))?.write_all(input)?;
        let mut after = Vec::new();
        from.ok_or_else(|| Error::other("no output"))?
            .read_to_end(&mut after)?;
        let status = child.wait()?;
        if !status.success() {
            return Err(Error::other(format!("the program ended with {status}")));
        }
        let words = after.as_chunks::<4>().0.iter();
        Ok(words.map(|word| f32::from_le_bytes(*word)).collect())
    }
}

/// A command that does not receive signals to the group of this process.
fn apart(program: &Path) -> Command {
    let mut command = Command::new(program);
    command.process_group(0);
    command
}

/// A number below 2^32 of members or entries.
fn count(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}
