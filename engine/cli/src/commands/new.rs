//! `new`: writes a first study.

use super::{complain, consent::Consent, say};
use crate::first_study;
use clap::Args;
use contract::{
    Registry,
    draft::{DraftError, Given},
};
use document::{
    diagnostic::render,
    schema_check::{SLUG, mismatch},
};
use execution::world::fs;
use session::{Exit, Failure};
use std::{
    io::{ErrorKind, Write},
    path::{Path, PathBuf},
    time::Duration,
};
use study::Options;

/// The parts of the study.
#[derive(Debug, Args)]
pub(super) struct NewOptions {
    /// Name of the study; `NAME.yaml` is written into this folder.
    #[arg(value_name = "NAME")]
    name: String,
    /// Environment; where absent, one that suits a first study.
    #[arg(long, short = 'e', value_name = "ENVIRONMENT")]
    environment: Option<String>,
    /// Agent that learns; where absent, one that fits the environment.
    #[arg(long, short = 'a', value_name = "AGENT")]
    agent: Option<String>,
    /// Your own program by its command, as in "python train.py --seed 1", which runs once for some seconds; or the YAML
    /// file of a W&B sweep or a Hydra multirun.
    #[arg(long, value_name = "COMMAND|FILE", conflicts_with_all = ["environment", "agent"])]
    from: Option<String>,
    /// File or pattern of the program's own files, in addition to those that it imports and names.
    #[arg(long, value_name = "FILE", requires = "from")]
    source: Vec<String>,
    /// Longest time that the program runs.
    #[arg(long, value_name = "SECONDS", requires = "from", default_value_t = 20)]
    #[arg(value_parser = clap::value_parser!(u64).range(1..=3600))]
    seconds: u64,
    #[command(flatten)]
    consent: Consent,
}

/// Writes the study; an existing file stays unchanged.
pub(super) fn new(registry: &Registry, options: &NewOptions) -> Result<Exit, Failure> {
    let (environment, agent) = (options.environment.as_deref(), options.agent.as_deref());
    let name = options.name.strip_suffix(".yaml").unwrap_or(&options.name);
    let path = PathBuf::from(format!("{name}.yaml"));
    let shown = path.display();
    if fs::exists(&path) {
        return Err(exists(&path));
    }
    let text = match &options.from {
        None => first_study::write(registry, name, environment, agent)
            .map_err(|error| Failure::refusal(error.to_string()))?,
        Some(from) => drafted(registry, name, from, options)?,
    };
    let written = fs::File::create_new(&path).and_then(|mut file| file.write_all(text.as_bytes()));
    written.map_err(|error| match error.kind() {
        ErrorKind::AlreadyExists => exists(&path),
        _ => Failure::refusal(format!("cannot write `{shown}`: {error}")),
    })?;
    say(&format!(
        "{shown} is written and passes `check`; `regimen run {shown} -P smoke` tries it out, `regimen run {shown}` \
         runs it"
    ));
    Ok(Exit::Ok)
}

fn exists(path: &Path) -> Failure {
    Failure::refusal(format!(
        "`{}` is there already; choose another name, or remove it",
        path.display()
    ))
}

/// The study of a program, drafted from its command or from the file of a sweep.
fn drafted(registry: &Registry, name: &str, from: &str, options: &NewOptions) -> Result<String, Failure> {
    if mismatch(SLUG, name).is_some() {
        let error = first_study::FirstStudyError::Name { name: name.into() };
        return Err(Failure::refusal(error.to_string()));
    }
    let begin = registry
        .draft
        .ok_or_else(|| Failure::refusal("this program makes no study of programs"))?;
    let told = |error: DraftError| Failure::refusal(error.to_string());
    let mut draft = begin(&Given {
        from,
        folder: Path::new(""),
        sources: &options.source,
        runs_for: Duration::from_secs(options.seconds),
    })
    .map_err(told)?;
    options.consent.ask_for_commands(draft.starts())?;
    draft.look().map_err(told)?;
    let text = draft.text(name);
    passes(registry, name, &text)?;
    for note in draft.told() {
        complain(&format!("look at: {note}"));
    }
    Ok(text)
}

/// Refuses a text that does not pass `check`, with or without the profile for trying it out.
fn passes(registry: &Registry, name: &str, text: &str) -> Result<(), Failure> {
    for profile in [None, Some("smoke".to_owned())] {
        let options = Options {
            profile,
            ..Options::default()
        };
        let shown = format!("{name}.yaml (not written)");
        let study = study::load_text(text, &shown, Path::new(""), registry, &options);
        study.map_err(|found| {
            let found = render(&found, false);
            Failure::refusal(format!("the study that was made does not pass `check`:\n{found}"))
        })?;
    }
    Ok(())
}
