//! Studies: from one YAML file to everything that is asked for, checked so far that no name, metric, key or
//! range can be wrong.
//!
//! | file | what it does |
//! |---|---|
//! | `sections` | the sections of a study as they are written, as types |
//! | `json_schema` | the schema of a study with all plugins' parameters; sections are held against it first |
//! | `written` | named parts and their positions |
//! | `include`, `blocks`, `lay` | other files and common keys, laid under the study |
//! | `path` | dotted paths of sweeps, profiles, overrides and `--set` |
//! | `section` | a key of any other section, set from the command line |
//! | `seeds` | a number of seeds, or looks that are planned |
//! | `settings` | the profile and the options of the command line |
//! | `sweep`, `overrides` | what varies over the trials |
//! | `search` | keys whose best values are searched |
//! | `config` | defaults, presets, data files: a plugin's complete config |
//! | `cells` | combinations of environment, agent and setting |
//! | `grid` | the configs of a part at every point of a sweep |
//! | `taking` | what cells take from each other, in an order without circles |
//! | `specimens` | what cells would leave, for a check of those that take it |
//! | `facts` | makes environments and tries them out, or recalls what they announced |
//! | `tried` | tries out agents whose code is not this program's own |
//! | `builds`, `fit` | builds what the cells name, to hear what plugins refuse and what trials record |
//! | `cross_play` | plays: which agents meet after they were trained, and in which seats |
//! | `imported_runs` | runs of other programs, which stand where agents stand |
//! | `quotes` | values of the study in its own words |
//! | `search_checks` | searches against what trials record |
//! | `plan` | the trials of a study, what of them is new and how long it takes |
//! | `repeats` | samples of a sweep that came to the same setting |
//! | `resolved` | a study with all defaults written out |
//! | `confirmations` | claims that are held against further seeds |
//! | `way` | from a folder to a file |

mod blocks;
mod builds;
mod cell;
mod cells;
mod config;
mod confirmations;
mod cross_play;
mod editor_schema;
mod facts;
pub mod fit;
mod going_on;
mod grid;
mod imported_runs;
mod include;
mod json_schema;
mod known;
mod lay;
mod overrides;
mod path;
pub mod plan;
mod plugin_config;
mod quotes;
mod repeats;
mod resolved;
mod schedule;
mod search;
mod search_checks;
mod section;
mod sections;
mod seeds;
mod settings;
mod specimens;
mod sweep;
mod taking;
mod tried;
mod way;
mod written;

pub use builds::can_learn;
pub use confirmations::Confirmation;
pub use editor_schema::for_editors;
pub use json_schema::json_schema;
pub use plugin_config::{load_config, read_config};
pub use repeats::Repeats;
pub use resolved::{resolved_yaml, section_yaml};
pub use taking::Source;
pub use way::{along, name_from, way};

pub(crate) use cell::{Cell, Cells, Place};

use ::imported::Imported;
use analysis::{
    search::{Progress, Search},
    training_share::PaperBudget,
};
use cells::{MOST_TRIALS, Sections};
use contract::{Metric, Registry, trial_result::Success};
use document::{
    Node,
    diagnostic::{Diagnostic, Sources, Span, in_order},
    input_file,
    schema_check::{At, Checker, View},
};
use execution::{
    limits::{LimitError, Limits},
    store::Announcements,
};
use presentation::{
    answers::Answer,
    claim_spec::{ClaimSpec, Relevance},
    figure::FigureSpec,
    request::{self, Request},
    summary::Summary,
    table::TableSpec,
    vocabulary::Play,
};
use seeds::SeedPlan;
use serde_json::Value;
use statistics::spending::Design;
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};
use written::Written;

/// What a command line changes of a study.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Options {
    /// The profile to use.
    pub profile: Option<String>,
    /// `PATH=VALUE` words, applied after the profile, in order.
    pub sets: Vec<String>,
    /// Number of seeds in place of the study's.
    pub seeds: Option<u64>,
    /// How far the searches are, by name; they begin where nothing is given.
    pub searches: BTreeMap<String, Progress>,
    /// What environments announced before; all are tried out where nothing is given.
    pub announced: Option<Announcements>,
}

/// A study that passed every check.
#[derive(Debug, Clone)]
pub struct Study {
    /// Name of the study and of its folder of results.
    pub name: String,
    /// What it is about, as a heading; empty where absent.
    pub title: String,
    /// Where the published numbers come from; empty where absent.
    pub source: String,
    /// The verdicts that are read together with those of this study; its own alone where absent.
    pub family: Option<String>,
    /// What it came to, with placeholders; `None` where absent.
    pub summary: Option<Summary>,
    /// Its lines in the answers of all studies.
    pub answers: Vec<Answer>,
    /// Departures from the source, one sentence each.
    pub departures: Vec<String>,
    /// Names of the environments, in order.
    pub environments: Vec<String>,
    /// Names of the agents, in order.
    pub agents: Vec<String>,
    /// All seeds that it may use.
    pub seeds: Vec<u64>,
    /// The looks at which seeds are added until all that is judged is decided; `None` where their number is
    /// fixed.
    pub design: Option<Design>,
    /// What counts as a success of a seed.
    pub success: Option<Success>,
    /// How long the source trained.
    pub paper_budget: Option<PaperBudget>,
    /// Agents that a trained one must be better than to have learned.
    pub floors: Vec<String>,
    /// Which difference matters for claims that do not say it.
    pub relevance: Option<Relevance>,
    /// The profile that was used.
    pub profile: Option<String>,
    /// Names of all its profiles, in order.
    pub profiles: Vec<String>,
    /// Tables by name, in order.
    pub tables: Vec<(String, TableSpec)>,
    /// Figures by name, in order.
    pub figures: Vec<(String, FigureSpec)>,
    /// Claims, in order.
    pub claims: Vec<ClaimSpec>,
    /// Plays, in order.
    pub plays: Vec<Play>,
    /// Runs of other programs, in order; their names are among those of the agents.
    pub imported: Vec<Imported>,
    /// What one trial may use.
    pub limits: Limits,
    /// True where an environment was not tried out, since it is known what it announced.
    pub is_recalled: bool,
    /// What environments that are not this program's own announced when they were tried out, by id.
    pub announced: BTreeMap<String, Value>,
    /// What can be run and is probably not meant, sorted by position.
    pub warnings: Vec<Diagnostic>,
    /// Everything that its trials record, by name; where parts share a name, the first of protocol,
    /// environments and agents.
    pub metrics: Vec<Metric>,
    /// Names of the entries of `prepare`, in order.
    pub prepared: Vec<String>,
    /// Units of everything that the trials record and trace, by name.
    pub units: BTreeMap<String, String>,
    /// Samples of its sweep, where several came to the same setting.
    pub repeats: Option<Repeats>,
    /// Searches for settings, in order, with how far they are.
    pub searches: Vec<(Search, Progress)>,
    /// Combinations of environment, agent and setting, then the entries of `prepare`, then the settings that
    /// searches try.
    pub(crate) cells: Cells,
    /// The cells in an order in which each comes after those that it takes from.
    pub(crate) order: Vec<usize>,
    /// Version of the shared numerical code.
    pub(crate) numerics: u32,
    /// The sections that trials are made of, with all defaults.
    resolved: Vec<(String, resolved::Section)>,
    /// The folder that data files were sought from.
    folder: PathBuf,
    /// The files that it includes, in the order in which they were read.
    pub included: Vec<PathBuf>,
    /// Rounds of claims and published values on further seeds, in order; none under a profile and options of the
    /// command line.
    pub confirm: Vec<Confirmation>,
}

/// Reads and checks the study in a file.
///
/// # Errors
/// Everything that is wrong with it, sorted by position.
pub fn load(path: &Path, registry: &Registry, options: &Options) -> Result<Study, Vec<Diagnostic>> {
    let (name, text) = read_text(path)?;
    load_text(&text, &name, folder_of(path), registry, options)
}

/// The name of the study in a file, whatever its other sections say.
///
/// # Errors
/// What keeps the file from being read as one document.
pub fn name_in(path: &Path, registry: &Registry, options: &Options) -> Result<String, Vec<Diagnostic>> {
    let (name, text) = read_text(path)?;
    let (schema, mut sources) = (json_schema(registry), Sources::default());
    let composed =
        compose(&text, &name, folder_of(path), &schema, &mut sources, options).map_err(in_order)?;
    Ok(section(&composed.root, "study").unwrap_or_default())
}

/// The folder that files named by a study are sought from.
fn folder_of(path: &Path) -> &Path {
    path.parent().unwrap_or(Path::new(""))
}

/// What messages call a file, and its text.
fn read_text(path: &Path) -> Result<(String, String), Vec<Diagnostic>> {
    let name = path.display().to_string();
    let unreadable = |error: std::io::Error| {
        let mut sources = Sources::default();
        let source = sources.add_file(&name, "");
        vec![sources.error(
            Span {
                source,
                ..Span::default()
            },
            "",
            format!("cannot read the study: {error}"),
        )]
    };
    let bytes = input_file::read(path, input_file::Use::Study).map_err(unreadable)?;
    let text = document::decode(&name, &bytes)?;
    Ok((name, text))
}

/// Checks the study in a text. Messages call it `name`; data files are sought from `folder`.
///
/// # Errors
/// Everything that is wrong with it, sorted by position.
pub fn load_text(
    text: &str,
    name: &str,
    folder: &Path,
    registry: &Registry,
    options: &Options,
) -> Result<Study, Vec<Diagnostic>> {
    let mut sources = Sources::default();
    let schema = json_schema(registry);
    let Composed {
        root,
        included,
        mut found,
    } = compose(text, name, folder, &schema, &mut sources, options).map_err(in_order)?;
    found.extend(check_structure(&root, &schema, &sources));
    if !found.iter().any(about_limits) {
        found.extend(wrong_limits(&root, &sources));
    }
    let mut written = Written::read(&root);
    found.extend(written.name_clashes(&sources));
    let (fixed, errors) = settings::apply(&root, &mut written, &schema, &mut sources, options);
    let sources = &sources;
    found.extend(errors);
    let mut keep = |errors: Vec<Diagnostic>| found.extend(errors);
    let dimensions = sweep::read(&root, &written, &schema, sources, &fixed)
        .map_err(&mut keep)
        .unwrap_or_default();
    let overrides = overrides::read(&root, &written, &schema, sources, &dimensions, &fixed)
        .map_err(&mut keep)
        .unwrap_or_default();
    let excluded = overrides::read_exclude(&root, &written, sources)
        .map_err(&mut keep)
        .unwrap_or_default();
    let searches = search::read(&written, &schema, sources, (&fixed, &dimensions), options)
        .map_err(&mut keep)
        .unwrap_or_default();
    if found.iter().any(blocks_trials) {
        return Err(in_order(found));
    }
    let limits: Limits = section(&root, "limits").unwrap_or_default();
    let sections = Sections {
        written: &written,
        registry,
        schema: &schema,
        sources,
        folder,
        overrides: &overrides,
        dimensions: &dimensions,
        searches: &searches,
        excluded: &excluded,
        limits: &limits,
        announced: options.announced.as_ref(),
        is_as_written: options.profile.is_none() && options.sets.is_empty() && options.seeds.is_none(),
    };
    let study = finish(&root, &sections, found)?;
    Ok(Study {
        profile: options.profile.clone(),
        included,
        ..study
    })
}

/// A study as one document.
struct Composed {
    root: Node,
    included: Vec<PathBuf>,
    found: Vec<Diagnostic>,
}

/// The document with what it includes, its blocks and the sections that options of the command line set.
fn compose(
    text: &str,
    name: &str,
    folder: &Path,
    schema: &Value,
    sources: &mut Sources,
    options: &Options,
) -> Result<Composed, Vec<Diagnostic>> {
    let source = sources.add_file(name, text);
    let root = document::parse(sources, source, text)?;
    let file = folder.join(Path::new(name).file_name().unwrap_or_default());
    let included = include::read(root, &file, schema, sources)?;
    let mut root = included.root;
    blocks::expand(&mut root, schema, sources)?;
    let found = settings::lay_sections(&mut root, schema, sources, options);
    Ok(Composed {
        root,
        included: included.files,
        found,
    })
}

/// What the second half of loading makes.
struct Made {
    plan: SeedPlan,
    success: Option<Success>,
    cells: Cells,
    order: Vec<usize>,
    vocabulary: presentation::vocabulary::Vocabulary,
    imported: Vec<Imported>,
    request: Request,
    confirm: Vec<Confirmation>,
    resolved: Vec<(String, resolved::Section)>,
    title: String,
    departures: Vec<String>,
}

/// The second half of loading: cells are made and built, and what is asked of them is checked.
fn finish(root: &Node, sections: &Sections<'_>, found: Vec<Diagnostic>) -> Result<Study, Vec<Diagnostic>> {
    make(root, sections, found).map(|made| assemble(root, sections, made))
}

fn make(root: &Node, sections: &Sections<'_>, mut found: Vec<Diagnostic>) -> Result<Made, Vec<Diagnostic>> {
    let sources = sections.sources;
    let known = found.clone();
    let with = |more: Vec<Diagnostic>| in_order(known.iter().cloned().chain(more).collect());
    let plan = SeedPlan::read(sections.written.seeds.as_ref(), sources).map_err(&with)?;
    if let Some(error) = too_many(root, sections, plan.seeds.len()) {
        return Err(with(vec![error]));
    }
    if let Some(error) = searched_seed(root, sections, &plan) {
        return Err(with(vec![error]));
    }
    let success: Option<Success> = section(root, "success");
    let cells = sections.cells().map_err(&with)?;
    let (cells, order) = taking::link(sections, cells, &plan.seeds).map_err(&with)?;
    let mut vocabulary = builds::build(sections, &cells, &plan.seeds[..plan.certain()]).map_err(&with)?;
    let imported = imported_runs::resolve(root, sections, &plan, &mut vocabulary).map_err(&with)?;
    let about_success = request::success(root, success.as_ref(), &mut vocabulary, sources);
    vocabulary.plays = cross_play::resolve(sections, &cells, plan.seeds.len())
        .map_err(|errors| with(about_success.iter().cloned().chain(errors).collect()))?;
    let resolved = resolved::sections(root, sections, &plan, &vocabulary.plays);
    let root = &quotes::fill(root, &resolved, sources).unwrap_or_else(|errors| {
        found.extend(errors);
        root.clone()
    });
    let request = Request::read(root, &vocabulary, sources, sections.folder);
    found.extend(
        about_success
            .into_iter()
            .chain(search_checks::searches(sections, &vocabulary)),
    );
    found.extend(request::beside_the_source(root, &vocabulary, sources));
    found.extend(request.found.iter().cloned());
    let searched = sections.searches.iter().flat_map(|it| &it.search.seeds);
    let used: Vec<u64> = plan.seeds.iter().chain(searched).copied().collect();
    let confirm = if sections.is_as_written {
        confirmations::read(root, (&request.claims, &request.tables), &used, sources)
    } else {
        // Profiles and options make another study of it, which confirms nothing.
        Ok(Vec::new())
    };
    let confirm = confirm.unwrap_or_else(|errors| {
        found.extend(errors);
        Vec::new()
    });
    if !found.is_empty() {
        return Err(in_order(found));
    }
    Ok(Made {
        plan,
        success,
        cells,
        order,
        vocabulary,
        imported,
        request,
        confirm,
        resolved,
        title: section(root, "title").unwrap_or_default(),
        departures: section(root, "departures").unwrap_or_default(),
    })
}

/// What a chosen setting is worth is measured on other seeds than those by which it was chosen.
fn searched_seed(root: &Node, sections: &Sections<'_>, plan: &SeedPlan) -> Option<Diagnostic> {
    let entry = root.entry("seeds")?;
    let used = |it: &search::Searched<'_>| {
        it.search
            .seeds
            .iter()
            .copied()
            .find(|seed| plan.seeds.contains(seed))
    };
    let seed = sections.searches.iter().find_map(used)?;
    let message = format!(
        "seed {seed} is one by which a search chooses, so that what it chooses would look better than it is"
    );
    let error = sections.sources.error(entry.key_span, "seeds", message);
    Some(error.help("use smaller seeds"))
}

/// A section that was held against its schema before; `None` where it is absent.
fn section<T: serde::de::DeserializeOwned>(root: &Node, name: &str) -> Option<T> {
    serde_json::from_value(root.get(name)?.to_value()).ok()
}

fn assemble(root: &Node, sections: &Sections<'_>, made: Made) -> Study {
    let Made {
        plan,
        success,
        cells,
        order,
        vocabulary,
        imported,
        request,
        confirm,
        resolved,
        title,
        departures,
    } = made;
    let profiles = root.get("profiles").map_or(&[][..], Node::entries);
    Study {
        name: section(root, "study").unwrap_or_default(),
        title,
        source: section(root, "source").unwrap_or_default(),
        family: section(root, "family"),
        summary: request.summary,
        answers: request.answers,
        departures,
        environments: vocabulary.environments,
        agents: vocabulary.agents,
        resolved,
        plays: vocabulary.plays,
        seeds: plan.seeds,
        design: plan.design,
        success,
        paper_budget: section(root, "paper_budget"),
        floors: section(root, "floors").unwrap_or_default(),
        relevance: section(root, "relevance"),
        profile: None,
        profiles: profiles.iter().map(|entry| entry.key.clone()).collect(),
        tables: request.tables,
        figures: request.figures,
        claims: request.claims,
        imported,
        limits: sections.limits.clone(),
        is_recalled: vocabulary.is_recalled,
        announced: vocabulary.announced,
        warnings: in_order(sections.repeats().chain(vocabulary.warnings).collect()),
        repeats: sections.dimensions.iter().find_map(Repeats::of),
        searches: sections.searches.iter().map(search::progress).collect(),
        metrics: vocabulary.metrics,
        units: vocabulary.units,
        prepared: sections
            .written
            .prepared
            .iter()
            .map(|entry| entry.name.clone())
            .collect(),
        cells,
        order,
        numerics: sections.registry.numerics_version,
        folder: sections.folder.to_path_buf(),
        included: Vec::new(),
        confirm,
    }
}

fn check_structure(root: &Node, schema: &Value, sources: &Sources) -> Vec<Diagnostic> {
    let mut checker = Checker::new(sources);
    let start = Span {
        length: 1,
        ..root.span
    };
    checker.check(
        root,
        &At {
            key: start,
            name: String::new(),
            path: String::new(),
        },
        &View::new(schema, schema),
    );
    checker.found
}

/// A limit that its schema allows and that limits nothing or everything.
fn wrong_limits(root: &Node, sources: &Sources) -> Option<Diagnostic> {
    let limits: Limits = section(root, "limits")?;
    let LimitError { key, value, instead } = limits.check().err()?;
    let span = root.get("limits")?.get(key)?.span;
    let message = format!("`{key}` is {value}, which is no limit");
    Some(
        sources
            .error(span, &format!("limits.{key}"), message)
            .help(instead),
    )
}

fn about_limits(diagnostic: &Diagnostic) -> bool {
    diagnostic.path.split('.').next() == Some("limits")
}

/// True where trials cannot be made before the mistake is mended; mistakes in what is only shown do not hide
/// others.
fn blocks_trials(diagnostic: &Diagnostic) -> bool {
    const SHOWN: [&str; 15] = [
        "answers",
        "confirm",
        "family",
        "title",
        "source",
        "summary",
        "departures",
        "success",
        "paper_budget",
        "floors",
        "relevance",
        "tables",
        "figures",
        "claims",
        "limits",
    ];
    let first = diagnostic.path.split(['.', '[']).next().unwrap_or_default();
    !SHOWN.contains(&first)
}

fn too_many(root: &Node, sections: &Sections<'_>, n_seeds: usize) -> Option<Diagnostic> {
    let trials = sections.count().saturating_mul(n_seeds as u64);
    if trials <= MOST_TRIALS {
        return None;
    }
    let section = if sections.dimensions.is_empty() {
        "seeds"
    } else {
        "sweep"
    };
    let span = root.entry(section).map_or(root.span, |entry| entry.key_span);
    let count = if trials == u64::MAX {
        "far too many".into()
    } else {
        trials.to_string()
    };
    let error = sections.sources.error(
        span,
        section,
        format!("this makes {count} trials, but a study has at most {MOST_TRIALS}"),
    );
    Some(error.help(
        "every `grid` key multiplies the trials; use `zip`, or sample with `random` or `latin_hypercube`",
    ))
}

#[cfg(test)]
mod tests;
