//! `new`: writes a first study.

use super::{BAD_SPEC, Failure, OK, say};
use crate::{Registry, first_study, world::fs};
use clap::Args;
use std::{
    io::{ErrorKind, Write},
    path::PathBuf,
};

/// What the study is made of.
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
}

/// Writes the study; a file that is there stays as it is.
pub(super) fn new(registry: &Registry, options: &NewOptions) -> Result<u8, Failure> {
    let refused = |text: String| Failure {
        code: BAD_SPEC,
        text: format!("error: {text}"),
    };
    let (environment, agent) = (options.environment.as_deref(), options.agent.as_deref());
    let name = options.name.strip_suffix(".yaml").unwrap_or(&options.name);
    let path = PathBuf::from(format!("{name}.yaml"));
    let shown = path.display();
    let exists = || {
        refused(format!(
            "`{shown}` is there already; choose another name, or remove it"
        ))
    };
    if fs::exists(&path) {
        return Err(exists());
    }
    let text =
        first_study::write(registry, name, environment, agent).map_err(|error| refused(error.to_string()))?;
    let written = fs::File::create_new(&path).and_then(|mut file| file.write_all(text.as_bytes()));
    written.map_err(|error| match error.kind() {
        ErrorKind::AlreadyExists => exists(),
        _ => refused(format!("cannot write `{shown}`: {error}")),
    })?;
    say(&format!(
        "{shown} is written and passes `check`; `regimen run {shown} -P smoke` tries it out, `regimen run {shown}` \
         runs it"
    ));
    Ok(OK)
}
