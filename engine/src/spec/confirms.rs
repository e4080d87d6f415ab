//! `confirms`: studies whose claims this one holds, word for word, against seeds that they have not seen.
//!
//! A claim that is open after all seeds of its study is no better for a few more of them, which were added because
//! of what was seen. It is for other seeds to say, and for a study that names them before the first trial.

use super::{ClaimSpec, Options, Place, Study, along, include, known::Resolved, load_alone};
use crate::{
    Registry,
    diagnostic::{self, Diagnostic, Sources, Span},
    document::{self, Node},
    input_file,
    reach::{Outside, Reach},
    table::TableSpec,
    trial::Part,
};
use serde_json::{Value, json};
use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

/// Most studies that one may confirm, those that they confirm counted.
const MOST: usize = 64;

/// A study that another one confirms.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Confirmed {
    /// Its name.
    pub study: String,
    /// Its file, from the folder of the study that confirms it.
    pub file: PathBuf,
}

/// The studies that the study in `file` names, read and held against it.
///
/// # Errors
/// Files that hold no study, seeds that have been seen, and what none of the studies asks or asks of something else.
pub fn read(
    (root, file): (&Node, &Path),
    study: &Study,
    registry: &Registry,
    sources: &Sources,
    options: &Options,
) -> Result<Vec<Confirmed>, Vec<Diagnostic>> {
    let named = include::named(root, "confirms");
    let reader = Reader::read(&named, study, file, registry, (sources, options))?;
    let others: Vec<&Study> = named
        .iter()
        .filter_map(|(name, _)| reader.study(study, name))
        .collect();
    // Profiles and options make another study of it, which confirms nothing.
    let is_as_written = options.profile.is_none() && options.sets.is_empty() && options.seeds.is_none();
    if others.is_empty() || !is_as_written {
        return Ok(Vec::new());
    }
    let confirming = Confirming {
        root,
        study,
        others: &others,
        sources,
    };
    let mut found = confirming.new_claims();
    found.extend(confirming.new_values());
    found.extend(confirming.other_combination(named.first().map_or(root.span, |(_, span)| *span)));
    found.extend(confirming.seen_seed(reader.loaded.iter().map(|(_, other)| other)));
    if !found.is_empty() {
        return Err(found);
    }
    let confirmed = others.iter().zip(named).map(|(other, (name, _))| Confirmed {
        study: other.name.clone(),
        file: name.into(),
    });
    Ok(confirmed.collect())
}

/// Reads studies and those that they confirm themselves, each once.
struct Reader<'a> {
    registry: &'a Registry,
    /// The options of the study as it is written, with what environments announced before.
    options: Options,
    /// The study for which they are read.
    own: PathBuf,
    loaded: Vec<(PathBuf, Study)>,
}

impl<'a> Reader<'a> {
    fn read(
        named: &[(String, Span)],
        study: &Study,
        file: &Path,
        registry: &'a Registry,
        (sources, options): (&Sources, &Options),
    ) -> Result<Self, Vec<Diagnostic>> {
        let own = along(Path::new(""), file);
        let options = Options {
            announced: options.announced.clone(),
            ..Options::default()
        };
        let mut reader = Self {
            registry,
            options,
            own,
            loaded: Vec::new(),
        };
        let mut found = Vec::new();
        let reach = Reach::of(&study.folder);
        for (name, span) in named.iter().take(MOST + 1) {
            let path = match reach.find(&study.folder, name) {
                Ok(path) => path,
                Err(outside) => {
                    let error = sources.error(*span, "confirms", outside.to_string());
                    found.push(error.help(Outside::HELP));
                    continue;
                }
            };
            if let Err(refused) = reader.load(&path) {
                let Refused { problem, .. } = &refused;
                let message =
                    format!("the study `{name}`, which this one confirms, cannot be taken: {problem}");
                let help =
                    "files are sought from the folder of this study; `regimen check` says more of them";
                let error = sources.error(*span, "confirms", message).help(help);
                found.push(if refused.is_unavailable {
                    error.as_unavailable()
                } else {
                    error
                });
            }
        }
        if found.is_empty() { Ok(reader) } else { Err(found) }
    }

    fn study(&self, from: &Study, name: &str) -> Option<&Study> {
        let file = along(Path::new(""), &from.folder.join(name));
        self.loaded
            .iter()
            .find(|(known, _)| *known == file)
            .map(|(_, study)| study)
    }

    /// Loads a study and those that it confirms; what is wrong where that cannot be.
    fn load(&mut self, path: &Path) -> Result<(), Refused> {
        let file = along(Path::new(""), path);
        if file == self.own {
            return Err("nothing confirms itself, not by way of others either"
                .to_owned()
                .into());
        }
        if self.loaded.iter().any(|(known, _)| *known == file) {
            return Ok(());
        }
        if self.loaded.len() == MOST {
            return Err(format!("{MOST} are the most, with those that they confirm").into());
        }
        let (study, root) = load(path, self.registry, &self.options)?;
        let (folder, reach) = (study.folder.clone(), Reach::of(&study.folder));
        self.loaded.push((file, study));
        include::named(&root, "confirms")
            .iter()
            .try_for_each(|(name, _)| {
                let path = reach.find(&folder, name).map_err(|outside| outside.to_string())?;
                self.load(&path)
            })
    }
}

/// Why a study cannot be taken.
struct Refused {
    problem: String,
    /// True where this machine lacks what it needs.
    is_unavailable: bool,
}

impl From<String> for Refused {
    fn from(problem: String) -> Self {
        Self {
            problem,
            is_unavailable: false,
        }
    }
}

impl From<Vec<Diagnostic>> for Refused {
    fn from(found: Vec<Diagnostic>) -> Self {
        let first = found.first().map_or_else(String::new, |it| {
            format!("{}:{}: {}", it.place.file, it.place.line, it.message)
        });
        Self {
            problem: first,
            is_unavailable: diagnostic::are_unavailable(&found),
        }
    }
}

/// A study without those that it confirms itself, and its document; what is wrong with it where it is none.
fn load(path: &Path, registry: &Registry, options: &Options) -> Result<(Study, Node), Refused> {
    let shown = path.display().to_string();
    let bytes = input_file::read(path, input_file::Use::Study).map_err(|error| error.to_string())?;
    let text = document::decode(&shown, &bytes)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut sources = Sources::default();
    Ok(load_alone(
        &text,
        &shown,
        folder,
        registry,
        options,
        &mut sources,
    )?)
}

/// A study beside those that it confirms.
struct Confirming<'a> {
    root: &'a Node,
    study: &'a Study,
    others: &'a [&'a Study],
    sources: &'a Sources,
}

impl Confirming<'_> {
    /// A seed that one of the others has seen, or one that these confirm.
    fn seen_seed<'s>(&self, mut others: impl Iterator<Item = &'s Study>) -> Option<Diagnostic> {
        let of_study = |other: &'s Study| {
            let seen: BTreeSet<&u64> = other.seeds.iter().collect();
            let again = self.study.seeds.iter().find(|seed| seen.contains(seed))?;
            Some((*again, &other.name, **seen.last()?))
        };
        let (seed, name, last) = others.find_map(of_study)?;
        let message =
            format!("seed {seed} is one of `{name}`, which this study confirms: what it says is known");
        let next = last.saturating_add(1);
        let help = format!(
            "use other seeds, as in `seeds: {next}-{}` or `first: {next}` of a design",
            next.saturating_add(9)
        );
        let span = self
            .root
            .entry("seeds")
            .map_or(self.root.span, |entry| entry.key_span);
        Some(self.sources.error(span, "seeds", message).help(help))
    }

    /// Claims that none of the others makes.
    fn new_claims(&self) -> Vec<Diagnostic> {
        let items = self.root.get("claims").map_or(&[][..], Node::items);
        let known = || self.others.iter().flat_map(|other| &other.claims);
        let is_new = |claim: &ClaimSpec| !claim.exploratory && !known().any(|it| is_same(it, claim));
        let new = self
            .study
            .claims
            .iter()
            .zip(0..)
            .filter(|(claim, _)| is_new(claim));
        let error = |(_, index): (&ClaimSpec, usize)| {
            let span = items.get(index).map_or(self.root.span, |it| it.span);
            let message = "no study that this one confirms makes this claim";
            let help = "write it as it stands there, with no larger `matters`, or say `exploratory: true`";
            let error = self.sources.error(span, &format!("claims[{index}]"), message);
            error.help(help)
        };
        new.map(error).collect()
    }

    /// Tables with published values that none of the others has, or has within another margin.
    fn new_values(&self) -> Vec<Diagnostic> {
        let known = |name: &String, spec: &TableSpec| {
            let tables = self.others.iter().flat_map(|other| &other.tables);
            tables
                .filter(|(other, _)| other == name)
                .any(|(_, other)| has_values(other, spec))
        };
        let tables = self.study.tables.iter();
        let new = tables
            .filter(|(name, spec)| !spec.exploratory && !spec.published.is_empty() && !known(name, spec));
        let error = |(name, _): &(String, TableSpec)| {
            let entry = self.root.get("tables").and_then(|tables| tables.entry(name));
            let span = entry.map_or(self.root.span, |entry| entry.key_span);
            let message = "no study that this one confirms has these published values with this margin in a table of this name";
            let help = "take them as they stand there, or say `exploratory: true`";
            self.sources
                .error(span, &format!("tables.{name}"), message)
                .help(help)
        };
        new.map(error).collect()
    }

    /// A combination, or an entry of `prepare`, that one of the others has under the same name with something else in
    /// it.
    fn other_combination(&self, span: Span) -> Option<Diagnostic> {
        let own: Vec<(String, [String; 3])> = combinations(self.study).collect();
        let differs = |other: &&Study| {
            let theirs: BTreeMap<String, [String; 3]> = combinations(other).collect();
            let part_of = |(name, parts): &(String, [String; 3])| {
                let known = theirs.get(name)?;
                let part = (0..PARTS.len()).find(|part| parts[*part] != known[*part])?;
                Some((name.clone(), PARTS[part], other.name.clone()))
            };
            own.iter().find_map(part_of)
        };
        let (name, part, other) = self.others.iter().find_map(differs)?;
        let message = format!("{name} has another {part} here than in `{other}`, which this study confirms");
        let help = "`include` the study, and change nothing but the seeds and what is left out";
        Some(self.sources.error(span, "confirms", message).help(help))
    }
}

/// What combinations are made of.
const PARTS: [&str; 3] = ["environment", "agent", "protocol"];

/// Combinations and entries of `prepare` in words, each with hashes of its parts. What a part takes from others is
/// known by its name there.
fn combinations(study: &Study) -> impl Iterator<Item = (String, [String; 3])> {
    study.cells.iter().filter_map(|cell| {
        let name = match cell.place {
            Place::Combination(environment, agent) => {
                format!(
                    "`{}` in `{}`",
                    study.agents.get(agent)?,
                    study.environments.get(environment)?
                )
            }
            Place::Prepared(index) => format!("`{}`", study.prepared.get(index)?),
            Place::Tried(_) | Place::Leading(..) => return None,
        };
        let setting = if cell.point.is_empty() {
            String::new()
        } else {
            format!(" ({})", cell.point)
        };
        let hash = |resolved: &Resolved| {
            let part = Part::clone(&resolved.part);
            let products = BTreeMap::new();
            Part { products, ..part }.id()
        };
        Some((name + &setting, cell.parts.each_ref().map(|part| hash(part))))
    })
}

/// True where a table has all published values of another one, within the same margin.
fn has_values(table: &TableSpec, of: &TableSpec) -> bool {
    is_within(&json!(of.published), &json!(table.published)) && of.margin == table.margin
}

/// True where every value of one mapping stands in the other one, too.
fn is_within(one: &Value, other: &Value) -> bool {
    match (one, other) {
        (Value::Object(one), Value::Object(other)) => one
            .iter()
            .all(|(key, value)| other.get(key).is_some_and(|other| is_within(value, other))),
        _ => one == other,
    }
}

/// True where the words of both are the same, so is the environment, or one of those of the first, and no larger
/// difference is passed over. What matters may be said where nothing was: of seeds that were not seen it is said before.
fn is_same(of_other: &ClaimSpec, claim: &ClaimSpec) -> bool {
    let words = |it: &ClaimSpec| it.claim.split_whitespace().collect::<Vec<_>>().join(" ");
    let place_fits = of_other.environment.is_none() || of_other.environment == claim.environment;
    let is_as_strict = |own: f64| of_other.matters.is_none_or(|theirs| own <= theirs);
    words(of_other) == words(claim) && place_fits && claim.matters.is_none_or(is_as_strict)
}
