//! `run --executor ssh`: contacts the hosts before anything runs, and refuses trials that they could not run.

use crate::{Exit, Failure, Planned, compute::Compute};
use contract::build;
use execution::{executor::Access, scheduler::hosts::HostReachability, world::fs};

/// Lets the hosts of `access` run the trials.
///
/// # Errors
/// Fails for trials that hosts cannot run, and for hosts that cannot be reached.
pub(crate) fn reach(how: &mut Compute<'_>, planned: &[Planned], access: &Access) -> Result<(), Failure> {
    if access.hosts.is_empty() {
        return Err(Failure::refusal(
            "regimen.toml: [ssh] `hosts`: name at least one, as in `hosts = [\"node1\", \"me@node2\"]`",
        ));
    }
    planned.iter().try_for_each(refuse)?;
    let settings = &how.session.settings;
    let version = build::version(how.session.registry.build.as_ref());
    let found = HostReachability::reach(access, &settings.store, &version, settings.lease_expiry)?;
    for (host, problem) in &found.left_out {
        how.session
            .notice(&format!("warning: {host} is left out: {problem}"));
    }
    if found.hosts.all.is_empty() {
        return Err(Failure {
            exit: Exit::Incomplete,
            text: "error: no host can be reached; nothing runs".into(),
        });
    }
    how.workers = found.hosts.all.iter().map(|host| host.capacity().cores).sum();
    how.hosts = found.hosts;
    Ok(())
}

/// Refuses studies that hosts cannot run. Hosts see the files of the folder in which the run was started, under the
/// same paths, and do not support pauses.
fn refuse(one: &Planned) -> Result<(), Failure> {
    let wrong = |text: String| Failure::refusal(format!("{}: {text}", one.study.name));
    let mut searches = one.study.searches.iter();
    if let Some((search, _)) = searches.find(|(search, _)| !search.pauses().is_empty()) {
        return Err(wrong(format!(
            "the search `{}` pauses trials, which stay on the host that ran them; run it here or with \
             `--executor slurm` or `hyperqueue`",
            search.name
        )));
    }
    let files = one.plan.trials.iter().flat_map(|trial| trial.key.data_files());
    let outside = files.map(|(path, _)| path).find(|path| !fs::is_inside(path));
    outside.map_or(Ok(()), |path| {
        Err(wrong(format!(
            "`{}` lies outside of this folder, of which alone hosts get files: start the run from a folder that \
             holds the study and its files, and name them from there",
            path.display()
        )))
    })
}
