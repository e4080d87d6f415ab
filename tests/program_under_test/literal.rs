//! A device that is a processor running the text of the kernels for a card, and one that is lost after some batches.

use card::{backend::Backend, device, literal::LiteralProcessor};
use contract::Registry;
use execution::device::{DeviceKind, RegisterDevice};
use plan::{cuda::Batch, executor::Lost};
use std::{ops::Range, path::PathBuf};

/// Batches after which the second device is lost.
const LASTS: usize = 60;

pub(super) fn register(registry: &mut Registry) {
    registry.device(DeviceKind {
        name: "literal",
        about: "the kernels for a card, run by the processor",
        serve: |ready| {
            device::serve_population(ready, |words| {
                let _ = words.send("a literal processor".into());
                Ok(LiteralProcessor::new(programs()?))
            })
        },
        connect: device::connect,
    });
    registry.device(DeviceKind {
        name: "short-lived",
        about: "as `literal`, lost after some batches",
        serve: |ready| {
            device::serve_population(ready, |words| {
                let _ = words.send("a short-lived processor".into());
                Ok(ShortLived(LiteralProcessor::new(programs()?), LASTS))
            })
        },
        connect: device::connect,
    });
}

/// A folder for compiled programs, which the test that has started this process removes with its own.
fn programs() -> Result<PathBuf, Lost> {
    let here = std::env::current_dir().map(|folder| folder.join(format!("programs-{}", std::process::id())));
    let made = here.and_then(|folder| std::fs::create_dir(&folder).map(|()| folder));
    made.map_err(|error| Lost {
        reason: error.to_string(),
    })
}

struct ShortLived(LiteralProcessor, usize);

impl Backend for ShortLived {
    fn reserve(&mut self, cohort: usize, state_size: usize, n_members: usize) -> Result<(), Lost> {
        self.0.reserve(cohort, state_size, n_members)
    }

    fn write(&mut self, cohort: usize, member: u32, first: usize, entries: &[f32]) -> Result<(), Lost> {
        self.0.write(cohort, member, first, entries)
    }

    fn read(&mut self, cohort: usize, member: u32, entries: Range<usize>) -> Result<Vec<f32>, Lost> {
        self.0.read(cohort, member, entries)
    }

    fn start(&mut self, cohort: usize, routine: usize, batch: &Batch<'_>) -> Result<(), Lost> {
        self.1 = self.1.checked_sub(1).ok_or_else(|| Lost {
            reason: "the card is lost: it fell off the bus".into(),
        })?;
        self.0.start(cohort, routine, batch)
    }

    fn finish(&mut self) -> Result<Vec<f32>, Lost> {
        self.0.finish()
    }
}
