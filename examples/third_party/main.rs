//! A program of somebody else: its own environment, agents, protocol, kinds of tables and
//! figures and executor beside the engine's.
//!
//! With arguments it does everything that `regimen` does with studies; without any it runs its own study, from the
//! folder in which that lies.
//!
//! ```text
//! third-party run examples/third_party/study.yaml --profile smoke
//! cd examples/third_party && third-party
//! ```

#![expect(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "the program speaks to a person"
)]

mod episodes;
mod lsf;
mod proportional;
mod spread;
mod thermostat;

use engine::{
    Registry,
    session::{
        Failure, MachineOptions, ReportOptions, Reported, RunOptions, Selection, Session, Silent,
        serve_if_asked,
    },
};
use std::process::ExitCode;

fn main() -> ExitCode {
    let ended = match serve_if_asked(registry) {
        Some(served) => served,
        None if std::env::args_os().len() > 1 => return engine::cli::main(registry),
        None => run_own_study().map(|()| ExitCode::SUCCESS),
    };
    ended.unwrap_or_else(|failure| {
        eprintln!("{failure}");
        ExitCode::from(failure.exit.code())
    })
}

/// Runs the study and prints what its claims come to.
fn run_own_study() -> Result<(), Failure> {
    let registry = registry();
    let selection = Selection::of("study.yaml");
    let session = Session::open(&registry, selection, MachineOptions::default(), &Silent)?;
    let mut planned = session.load_with_looks()?;
    session.run(&mut planned, &RunOptions::default())?;
    for reported in session.report(&planned, &ReportOptions::default())? {
        let Reported::Written(report) = reported else {
            continue;
        };
        println!("{}: {}", report.study.title, report.paths.page.display());
        for line in &report.contents.claims {
            match &line.verdict {
                Ok(claim) => println!("{}: {}", line.spec.claim, claim.verdict.word()),
                Err(problem) => println!("{}: {problem}", line.spec.claim),
            }
        }
    }
    Ok(())
}

fn registry() -> Registry {
    let mut registry = Registry::default();
    protocols::register(&mut registry);
    thermostat::register(&mut registry);
    proportional::register(&mut registry);
    episodes::register(&mut registry);
    spread::register(&mut registry);
    lsf::register(&mut registry);
    registry
}
