//! `verify`: computes stored trials again, beside the store, and compares digests.

use super::{Common, Format, LimitArgs, Studies, consent::Consent, say};
use clap::Args;
use contract::Registry;
use execution::store::write_durably;
use session::{Exit, Failure, VerifyOptions, exit_of_receipt};
use std::path::PathBuf;

/// The trials that are computed again.
#[derive(Debug, Clone, Args)]
pub(super) struct VerifyArgs {
    /// Study files; every trial of the store where absent.
    #[arg(value_name = "STUDY")]
    specs: Vec<PathBuf>,
    /// Profile of the study (a named budget).
    #[arg(long, short = 'P', value_name = "NAME")]
    profile: Option<String>,
    /// Replace one value, as in `--set dsac.discount=0.999`.
    #[arg(long = "set", short = 'S', value_name = "PATH=VALUE")]
    sets: Vec<String>,
    /// Number of seeds, instead of the study's.
    #[arg(long, value_name = "N")]
    seeds: Option<u64>,
    /// Only trials of these environments and agents (names of the study).
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,
    /// Number of trials to draw at random; all where absent.
    #[arg(long, value_name = "N")]
    sample: Option<usize>,
    /// Seed of the sample: the same seed draws the same trials.
    #[arg(long, value_name = "S", default_value_t = 0)]
    seed: u64,
    /// Worker processes; `workers` in regimen.toml, else the number of cores.
    #[arg(long, short = 'j', env = "REGIMEN_JOBS", value_name = "N", value_parser = super::one_or_more)]
    jobs: Option<usize>,
    /// Also write the receipt into a file, in the format of the output.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    limits: LimitArgs,
    #[command(flatten)]
    consent: Consent,
}

/// Exit code 101 if numbers differ, 106 if a trial could not be compared, otherwise 0.
pub(super) fn verify(registry: &Registry, options: &VerifyArgs, common: &Common) -> Result<Exit, Failure> {
    let session = options.studies().open(registry, common)?;
    let how = VerifyOptions {
        sample: options.sample,
        seed: options.seed,
        jobs: options.jobs,
        limits: options.limits.limits(),
    };
    let found = session.verifiable(&how)?;
    options.consent.ask_for(session.programs_to_verify(&found)?)?;
    let receipt = session.verify(found, &how)?;
    let text = match common.format {
        Format::Json => serde_json::to_string_pretty(&receipt)
            .map_err(|error| Failure::refusal(format!("the receipt cannot be written: {error}")))?,
        Format::Text => receipt.text(),
    };
    say(&text);
    if let Some(path) = &options.out {
        write_durably(path, format!("{text}\n").as_bytes())?;
    }
    Ok(exit_of_receipt(&receipt))
}

impl VerifyArgs {
    fn studies(&self) -> Studies {
        Studies {
            specs: self.specs.clone(),
            profile: self.profile.clone(),
            sets: self.sets.clone(),
            seeds: self.seeds,
            only: self.only.clone(),
        }
    }
}
