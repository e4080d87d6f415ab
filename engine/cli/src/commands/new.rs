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
    /// Environment; one that suits a first look where absent.
    #[arg(long, short = 'e', value_name = "ENVIRONMENT")]
    environment: Option<String>,
    /// Agent that learns; one that fits the environment where absent.
    #[arg(long, short = 'a', value_name = "AGENT")]
    agent: Option<String>,
    /// A program of your own by its command, as "python train.py --seed 1", which runs once for some seconds; or the
    /// YAML file of a sweep of W&B or a multirun of Hydra.
    #[arg(long, value_name = "COMMAND|FILE", conflicts_with_all = ["environment", "agent"])]
    from: Option<String>,
    /// File or pattern of the program's own files, besides those that it imports and names.
    #[arg(long, value_name = "FILE", requires = "from")]
    source: Vec<String>,
    /// How long the program runs at most.
    #[arg(long, value_name = "SECONDS", requires = "from", default_value_t = 20)]
    #[arg(value_parser = clap::value_parser!(u64).range(1..=3600))]
    seconds: u64,
    #[command(flatten)]
    consent: Consent,
}

/// Writes the study; a file that is there stays as it is.
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

/// The study of a program, which runs once for it.
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

/// Refuses a text that does not pass `check`, whole or tried out.
fn passes(registry: &Registry, name: &str, text: &str) -> Result<(), Failure> {
    for profile in [None, Some("smoke".to_owned())] {
        let options = Options {
            profile,
            ..Options::default()
        };
        let study = study::load_text(text, &format!("{name}.yaml"), Path::new(""), registry, &options);
        study.map_err(|found| {
            let found = render(&found, false);
            Failure::refusal(format!("the study that was made does not pass `check`:\n{found}"))
        })?;
    }
    Ok(())
}
