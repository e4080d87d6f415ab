//! Folders of results. Each belongs to one study file and to one set of command line options.

use crate::{Failure, Planned, ReportOptions, Selection, Session};
use contract::Error;
use execution::world::{fs, process};
use report::{Manifest, Replaced};
use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Component, Path, PathBuf},
};
use study::{along, way};

/// Name of a folder whose subfolders of studies are repeated in the folder of results.
const EXPERIMENTS: &str = "experiments";

/// Maximum length of the options in a folder's name.
const LONGEST: usize = 80;

/// The folder with the results of a study: `results/<study>`, `results/<study>-<profile>`, or
/// `results/<study>+<options>` with other options of the command line. The options keep changed results apart from
/// those of the study as written. For a study file in a subfolder of `experiments`, the same subfolder comes before the
/// name. A folder that the command line names holds one study, or one folder for each of several.
pub(crate) fn folder(one: &Planned, selection: &Selection, reporting: &ReportOptions) -> PathBuf {
    folder_of(&one.path, &one.study.name, selection, reporting)
}

/// The same for the study with a given name in a file.
pub(crate) fn folder_of(
    file: &Path,
    study: &str,
    selection: &Selection,
    reporting: &ReportOptions,
) -> PathBuf {
    let all = around(reporting);
    match &reporting.out {
        Some(_) if selection.is_one() => all,
        Some(_) => all.join(study),
        None => {
            let name = format!("{study}{}", asked(selection));
            all.join(below_experiments(file)).join(name)
        }
    }
}

/// The folders between `experiments` and a study file; empty if the file lies elsewhere.
fn below_experiments(file: &Path) -> PathBuf {
    let folder = file.parent().unwrap_or(Path::new(""));
    let parts: Vec<_> = folder.components().collect();
    let last = parts.iter().rposition(|part| part.as_os_str() == EXPERIMENTS);
    let below = last.map_or(&[][..], |last| &parts[last + 1..]);
    let are_names = below.iter().all(|part| matches!(part, Component::Normal(_)));
    if are_names {
        below.iter().collect()
    } else {
        PathBuf::new()
    }
}

/// The folder that contains the folders of several studies and their index.
pub(crate) fn around(reporting: &ReportOptions) -> PathBuf {
    reporting.out.clone().unwrap_or_else(|| "results".into())
}

/// The part of a folder's name that separates this selection from the studies as written: nothing, `-<profile>` or
/// `+<options>`.
pub(crate) fn asked(selection: &Selection) -> String {
    let profile = selection.profile.iter().map(|profile| format!("-{profile}"));
    profile
        .chain(changes(selection).map(|changes| format!("+{changes}")))
        .collect()
}

/// The changes of the command line other than the profile, as a part of a folder's name.
fn changes(selection: &Selection) -> Option<String> {
    let seeds = selection.seeds.iter().map(|seeds| format!("seeds={seeds}"));
    let only = selection.only.iter().map(|name| format!("only={name}"));
    let all = selection
        .sets
        .iter()
        .cloned()
        .chain(seeds)
        .chain(only)
        .collect::<Vec<_>>()
        .join("+");
    let keep = |letter: char| letter.is_ascii_alphanumeric() || "._-=+".contains(letter);
    let name: String = all
        .chars()
        .map(|letter| if keep(letter) { letter } else { '-' })
        .collect();
    // The name shows only a part of the options; a hash of all of them keeps it distinct.
    let whole = name == all && name.len() <= LONGEST;
    let named = || {
        if whole {
            name.clone()
        } else {
            format!(
                "{name:.LONGEST$}-{:.8}",
                contract::digest::of_bytes(all.as_bytes())
            )
        }
    };
    (!all.is_empty()).then(named)
}

/// The options that change the results of the study as written, as words of a command line.
pub(crate) fn options(selection: &Selection) -> Vec<String> {
    selection.options().chunks(2).map(|pair| pair.join(" ")).collect()
}

/// Before anything runs, refuses to write the results of different study files into one folder, and refuses folders
/// that cannot be written.
pub(crate) fn check(
    planned: &[Planned],
    selection: &Selection,
    reporting: &ReportOptions,
) -> Result<(), Failure> {
    let mut taken: BTreeMap<PathBuf, &Path> = BTreeMap::new();
    for one in planned.iter().filter(|one| one.confirms.is_none()) {
        let folder = folder(one, selection, reporting);
        let earlier = taken
            .insert(folder.clone(), &one.path)
            .filter(|earlier| !fs::is_same(earlier, &one.path));
        let earlier = earlier
            .map(Path::to_owned)
            .or_else(|| owner(&folder).filter(|owner| !fs::is_same(owner, &one.path)));
        if let Some(earlier) = earlier.filter(|earlier| fs::exists(earlier)) {
            return Err(refusal(&folder, &earlier, &one.path, selection, reporting));
        }
        probe(&folder)?;
    }
    Ok(())
}

/// Tries to write into a folder, or into its nearest parent that exists.
fn probe(folder: &Path) -> Result<(), Failure> {
    let there = |folder: &&Path| fs::is_taken(folder);
    let nearest = folder.ancestors().find(there).unwrap_or(Path::new("."));
    let file = nearest.join(format!(".regimen-{}", process::id()));
    let tried = fs::write(&file, "").and_then(|()| fs::remove_file(&file));
    tried.map_err(|error| {
        let (folder, nearest) = (folder.display(), nearest.display());
        Failure::refusal(format!(
            "results cannot be written to `{folder}`: `{nearest}`: {error}: give another folder with `-o`"
        ))
    })
}

fn refusal(
    folder: &Path,
    earlier: &Path,
    spec: &Path,
    selection: &Selection,
    reporting: &ReportOptions,
) -> Failure {
    let (folder, earlier, spec) = (folder.display(), earlier.display(), spec.display());
    let instead = match reporting.out {
        Some(_) if selection.is_one() => "give each a folder of its own with `-o`",
        _ => "rename one of the studies (`study:`), or give another folder with `-o`",
    };
    Failure::refusal(format!(
        "the results of `{spec}` would replace those of `{earlier}` in `{folder}`: {instead}"
    ))
}

/// The study file of the results in a folder, if the folder names it.
fn owner(folder: &Path) -> Option<PathBuf> {
    Some(along(folder, Path::new(&Manifest::read(folder)?.spec)))
}

/// Records in a folder the study file of its results and the files that a report wrote. Removes files that only an
/// earlier report wrote, except those in `unmade`, which this report could not make.
pub(crate) fn settle(
    session: &Session<'_>,
    folder: &Path,
    one: &Planned,
    files: &[PathBuf],
    unmade: &BTreeSet<String>,
) -> Result<(), Error> {
    let spec = way(folder, &one.path).display().to_string();
    let mut manifest = Manifest::of(folder, &one.study.name, spec, options(&session.selection), files)?;
    say_replaced(session, folder, &manifest.settle(folder, unmade)?);
    Ok(())
}

fn say_replaced(session: &Session<'_>, folder: &Path, replaced: &Replaced) {
    let folder = folder.display();
    let say = |names: &[String], what: &str| {
        if !names.is_empty() {
            session.notice(&format!("{folder}: {what}: {}", names.join(", ")));
        }
    };
    say(&replaced.removed, "files of an earlier report were removed");
    say(
        &replaced.changed,
        "files of an earlier report are not of this one, and stay because they were changed since",
    );
    say(
        &replaced.kept,
        "files of an earlier report stay, since what they show cannot be made now",
    );
    say(
        &replaced.unknown,
        "files that are not of this report, nobody noted whose they are, so they stay",
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    fn changed(sets: &[&str], seeds: Option<u64>, only: &[&str]) -> String {
        let owned = |words: &[&str]| words.iter().map(ToString::to_string).collect();
        let selection = Selection {
            specs: Vec::new(),
            profile: None,
            sets: owned(sets),
            seeds,
            only: owned(only),
        };
        changes(&selection).unwrap_or_default()
    }

    #[test]
    fn the_folders_below_experiments_are_those_of_results() {
        let below = |file: &str| below_experiments(Path::new(file));
        assert_eq!(below("experiments/chapter-2/a.yaml"), Path::new("chapter-2"));
        assert_eq!(below("/project/experiments/b/c/a.yaml"), Path::new("b/c"));
        for file in [
            "a.yaml",
            "b/a.yaml",
            "experiments/a.yaml",
            "experiments/../b/a.yaml",
        ] {
            assert_eq!(below(file), Path::new(""), "{file}");
        }
    }

    #[test]
    fn options_name_their_folder() {
        assert_eq!(changed(&[], None, &[]), "");
        assert_eq!(
            changed(&["dsac.discount=0.9"], Some(2), &["dsac"]),
            "dsac.discount=0.9+seeds=2+only=dsac"
        );
    }

    #[test]
    fn names_of_folders_are_short_and_differ_where_options_do() {
        let (one, two) = (
            changed(&["a.b=[1, 2]"], None, &[]),
            changed(&["a.b=[1; 2]"], None, &[]),
        );
        assert!(
            one.starts_with("a.b=-1--2--") && one.len() < 24 && !one.contains(['/', ' ']),
            "{one}"
        );
        assert_ne!(one, two);
        let long = |last: &str| {
            changed(
                &["x.y=1"; 40].into_iter().chain([last]).collect::<Vec<_>>(),
                None,
                &[],
            )
        };
        assert!(long("x.y=2").len() <= LONGEST + 9);
        assert_ne!(long("x.y=2"), long("x.y=3"));
        assert!(!changed(&["../../x=1"], None, &[]).contains('/'));
    }
}
