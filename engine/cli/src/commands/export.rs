//! `export`: writes a study's numbers into a folder in a form for other programs, or the policy or episodes of one
//! trial.

use super::{Common, Studies, say};
use clap::Args;
use contract::Registry;
use document::count::count;
use report::export::ExportFormat;
use session::{
    Exit, Failure, Settings,
    export_dataset::{self, TakenEpisodes},
    export_policy,
};
use std::path::{Path, PathBuf};

/// Options that select parts of a study; they do not apply to one trial.
const OF_A_STUDY: [&str; 7] = ["specs", "profile", "sets", "seeds", "only", "form", "license"];

/// The numbers to export, their form and their destination.
#[derive(Debug, Clone, Args)]
#[command(mut_arg("specs", |specs| specs.required(false).required_unless_present_any(["onnx", "minari"])))]
pub(super) struct ExportOptions {
    #[command(flatten)]
    studies: Studies,
    /// Folder to write; it must be empty or not exist yet.
    #[arg(long, short = 'o', value_name = "FOLDER")]
    to: PathBuf,
    /// Form to write.
    #[arg(long = "as", value_enum, value_name = "FORM", required_unless_present_any = ["onnx", "minari"])]
    form: Option<ExportFormat>,
    /// Instead of a study, export the policy of one trial of the store, by the first digits of its id: `policy.onnx`,
    /// or `<seat>.onnx` for every seat that has its own.
    #[arg(long, value_name = "TRIAL", conflicts_with_all = OF_A_STUDY, conflicts_with = "minari")]
    onnx: Option<String>,
    /// Instead of a study, export the episodes of one trial of the store as a Minari dataset: those that it gathered,
    /// or those that its policy plays (`--episodes`).
    #[arg(long, value_name = "TRIAL", conflicts_with_all = OF_A_STUDY)]
    minari: Option<String>,
    #[command(flatten)]
    play: Play,
    /// Licence of the results, required for a crate: an SPDX id such as CC-BY-4.0, or an address.
    #[arg(long, value_name = "LICENCE", required_if_eq("form", "ro-crate"))]
    license: Option<String>,
}

/// The episodes to play if nothing was gathered.
#[derive(Debug, Clone, Args)]
pub(super) struct Play {
    /// With `--minari` and a trial that gathered no dataset: number of episodes that its policy plays.
    #[arg(long, value_name = "N", requires = "minari", value_parser = clap::value_parser!(u64).range(1..))]
    episodes: Option<u64>,
    /// With `--episodes`: seed of the first episode, which counts up; 0 where absent.
    #[arg(long, value_name = "N", requires = "episodes")]
    seed: Option<u64>,
    /// With `--minari`: the folder below which Minari looks for datasets; the path below it is the id
    /// (`NAMESPACE/NAME-vN`). Where absent, the last two names of the path of the written folder are the id.
    #[arg(long, env = "MINARI_DATASETS_PATH", value_name = "FOLDER")]
    minari_root: Option<PathBuf>,
}

/// Exit code 106 if trials of a study are missing, 100 if some failed; the existing ones are written in either case.
pub(super) fn export(registry: &Registry, options: &ExportOptions, common: &Common) -> Result<Exit, Failure> {
    match (&options.onnx, &options.minari, options.form) {
        (Some(trial), ..) => {
            let store = Settings::read(registry, &common.machine())?.open(registry)?;
            let (id, names) = export_policy::of_trial(registry, &store, trial, &options.to)?;
            say(&format!(
                "trial {id}: {} in `{}`",
                names.join(", "),
                options.to.display()
            ));
            Ok(Exit::Ok)
        }
        (None, Some(trial), _) => {
            let store = Settings::read(registry, &common.machine())?.open(registry)?;
            let (to, play) = (&options.to, &options.play);
            let first = play.seed.unwrap_or(0);
            let seeds = play
                .episodes
                .map(|episodes| first..first.saturating_add(episodes));
            let root = play.minari_root.as_deref();
            say_taken(
                &export_dataset::of_trial(registry, &store, trial, seeds, to, root)?,
                to,
            );
            Ok(Exit::Ok)
        }
        (None, None, Some(form)) => of_study(registry, form, options, common),
        (None, None, None) => Err(Failure::refusal("say with `--as` in which form")),
    }
}

fn of_study(
    registry: &Registry,
    form: ExportFormat,
    options: &ExportOptions,
    common: &Common,
) -> Result<Exit, Failure> {
    let session = options.studies.open(registry, common)?;
    let license = options.license.as_deref().unwrap_or_default();
    let exported = session.export(form, &options.to, license)?;
    say(&format!(
        "{}: {} of {} in `{}`",
        exported.study,
        exported.ok,
        count(exported.trials, "trial"),
        options.to.display()
    ));
    Ok(exported.exit)
}

fn say_taken(taken: &TakenEpisodes, to: &Path) {
    say(&format!(
        "trial {}: {} of {} in `{}`",
        taken.trial,
        count(taken.episodes, "episode"),
        count(taken.decisions, "decision"),
        to.display()
    ));
    say(&match (&taken.id, &taken.root) {
        (Some(id), Some(root)) => format!(
            "its id is `{id}`: Minari finds it by this name where its root is `{}`",
            root.display()
        ),
        _ => {
            "Minari lists it by no name: those that it lists lie in a folder NAMESPACE/NAME-vN below its root"
                .into()
        }
    });
}
