//! Reads a study from its file, checks it and makes it ready to be planned.

use super::{
    blocks, builds,
    cells::Cells,
    checked_sections::{MOST_TRIALS, Sections},
    checked_study::Study,
    confirmations::{self, Confirmation},
    cross_play, dependencies, imported_runs, include,
    json_schema::{check_structure, json_schema},
    overrides, quotes,
    repeats::Repeats,
    resolved, search, search_checks, search_overlaps,
    sections::StudyText,
    seeds::SeedPlan,
    settings::{self, Options},
    sweep,
    written::Written,
};
use ::imported::Imported;
use contract::Registry;
use document::{
    Node,
    diagnostic::{Diagnostic, Sources, Span, in_order},
};
use execution::limits::LimitError;
use presentation::request::{self, Kinds, Request};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Reads and checks the study in a file.
///
/// # Errors
/// Everything that is wrong with it, sorted by position.
pub fn load(path: &Path, registry: &Registry, options: &Options) -> Result<Study, Vec<Diagnostic>> {
    let (name, text) = read_text(path, options)?;
    load_text(&text, &name, folder_of(path), registry, options)
}

/// The name of the study in a file, even if other sections are wrong.
///
/// # Errors
/// Mistakes that keep the file from being read as one document.
pub fn name_in(path: &Path, registry: &Registry, options: &Options) -> Result<String, Vec<Diagnostic>> {
    let (name, text) = read_text(path, options)?;
    let (schema, mut sources) = (json_schema(registry), Sources::default());
    let composed =
        compose(&text, &name, folder_of(path), &schema, &mut sources, options).map_err(in_order)?;
    Ok(StudyText::read(&composed.root).study.0.unwrap_or_default())
}

/// Folder relative to which the files that a study names are found.
fn folder_of(path: &Path) -> &Path {
    path.parent().unwrap_or(Path::new(""))
}

/// Name of a file for messages, and its text.
fn read_text(path: &Path, options: &Options) -> Result<(String, String), Vec<Diagnostic>> {
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
    let bytes = options.texts.read(path).map_err(unreadable)?;
    let text = document::decode(&name, &bytes)?;
    Ok((name, text))
}

/// Checks the study in a text. `name` is its name in messages; data files are found relative to `folder`.
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
    let composed = compose(text, name, folder, &schema, &mut sources, options).map_err(in_order)?;
    let (root, mut found) = (composed.root, composed.found);
    let mut text = StudyText::read(&root);
    check_form(&root, &text, &schema, &sources, &mut found);
    let mut written = Written::read(&root);
    found.extend(written.name_clashes(&sources));
    let (fixed, errors) = settings::apply(&root, &text, &mut written, &schema, &mut sources, options);
    text.read_parts(&written);
    let sources = &sources;
    found.extend(errors);
    let dimensions = sweep::read(&root, &text.sweep, &written, &schema, sources, &fixed);
    let dimensions = kept(dimensions, &mut found);
    let given = (&fixed[..], &dimensions[..]);
    let overrides = overrides::read(&root, &text.overrides, &written, &schema, sources, given);
    let overrides = kept(overrides, &mut found);
    let excluded = overrides::read_exclude(&root, &text.exclude, &written, sources);
    let excluded = kept(excluded, &mut found);
    let searches = search::read(&text.tune, &written, &schema, sources, given, &options.searches);
    let searches = kept(searches, &mut found);
    found.extend(search_overlaps::overlaps(&searches, &overrides, sources));
    if found.iter().any(blocks_trials) {
        return Err(in_order(found));
    }
    let limits = text.limits.0.clone().unwrap_or_default();
    let sections = Sections {
        text: &text,
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
        known: &options.known,
        is_as_written: options.profile.is_none() && options.sets.is_empty() && options.seeds.is_none(),
    };
    let study = finish(&root, &sections, found)?;
    Ok(Study {
        profile: options.profile.clone(),
        included: composed.included,
        ..study
    })
}

/// The value of a section; the default if it has mistakes, which are added to `found`.
fn kept<T: Default>(read: Result<T, Vec<Diagnostic>>, found: &mut Vec<Diagnostic>) -> T {
    read.unwrap_or_else(|errors| {
        found.extend(errors);
        T::default()
    })
}

/// Checks a document against the schema, and the limits in it.
fn check_form(root: &Node, text: &StudyText, schema: &Value, sources: &Sources, found: &mut Vec<Diagnostic>) {
    found.extend(check_structure(root, schema, sources));
    if !found.iter().any(about_limits) {
        found.extend(wrong_limits(root, text, sources));
    }
}

/// A study as one document.
struct StudyDocument {
    root: Node,
    included: Vec<PathBuf>,
    found: Vec<Diagnostic>,
}

/// The document with its includes, its blocks and the sections that options of the command line set.
fn compose(
    text: &str,
    name: &str,
    folder: &Path,
    schema: &Value,
    sources: &mut Sources,
    options: &Options,
) -> Result<StudyDocument, Vec<Diagnostic>> {
    let source = sources.add_file(name, text);
    let root = document::parse(sources, source, text)?;
    let file = folder.join(Path::new(name).file_name().unwrap_or_default());
    let included = include::read(root, &file, schema, sources, &options.texts)?;
    let mut root = included.root;
    blocks::expand(&mut root, schema, sources)?;
    let found = settings::lay_sections(&mut root, schema, sources, options);
    Ok(StudyDocument {
        root,
        included: included.files,
        found,
    })
}

/// Result of the second half of loading.
struct FinishedSections {
    plan: SeedPlan,
    cells: Cells,
    order: Vec<usize>,
    vocabulary: presentation::vocabulary::Vocabulary,
    imported: Vec<Imported>,
    request: Request,
    confirm: Vec<Confirmation>,
    resolved: Vec<(String, resolved::Section)>,
    /// The sections with values of the study in their texts.
    text: StudyText,
}

/// The second half of loading: cells are made and built, and the sections on results are checked.
fn finish(root: &Node, sections: &Sections<'_>, found: Vec<Diagnostic>) -> Result<Study, Vec<Diagnostic>> {
    make(root, sections, found).map(|made| assemble(root, sections, made))
}

fn make(
    root: &Node,
    sections: &Sections<'_>,
    mut found: Vec<Diagnostic>,
) -> Result<FinishedSections, Vec<Diagnostic>> {
    let sources = sections.sources;
    let known = found.clone();
    let with = |more: Vec<Diagnostic>| in_order(known.iter().cloned().chain(more).collect());
    let seeds = (sections.text.seeds.0.as_ref(), sections.written.seeds.as_ref());
    let plan = SeedPlan::of(seeds.0, seeds.1, sources).map_err(&with)?;
    let refused = too_many(root, sections, plan.seeds.len());
    if let Some(error) = refused.or_else(|| searched_seed(root, sections, &plan)) {
        return Err(with(vec![error]));
    }
    let cells = sections.cells().map_err(&with)?;
    let (cells, order) = dependencies::link(sections, cells, &plan.seeds).map_err(&with)?;
    let mut vocabulary = builds::build(sections, &cells, &plan.seeds[..plan.certain()]).map_err(&with)?;
    let imported = imported_runs::resolve(root, sections, &plan, &mut vocabulary).map_err(&with)?;
    let about_success = request::success(root, sections.text.success.0.as_ref(), &mut vocabulary, sources);
    vocabulary.plays = cross_play::resolve(sections, &cells, plan.seeds.len())
        .map_err(|errors| with(about_success.iter().cloned().chain(errors).collect()))?;
    let resolved = resolved::sections(root, sections, &plan, &vocabulary.plays);
    let root = &quotes::fill(root, &resolved, sections).unwrap_or_else(|errors| {
        found.extend(errors);
        root.clone()
    });
    let text = StudyText::read(root);
    let asked = (&text.request, root);
    let kinds = Kinds::of(sections.registry);
    let request = Request::read(asked, &vocabulary, &kinds, sources, sections.folder);
    let beside = request::beside_the_source(asked.0, root, &vocabulary, sources);
    let of_searches = search_checks::searches(sections, &vocabulary);
    found.extend(about_success.into_iter().chain(of_searches).chain(beside));
    found.extend(request.found.iter().cloned());
    let confirm = confirmed(&text, root, sections, (&request, &plan)).unwrap_or_else(|errors| {
        found.extend(errors);
        Vec::new()
    });
    if !found.is_empty() {
        return Err(in_order(found));
    }
    Ok(FinishedSections {
        plan,
        cells,
        order,
        vocabulary,
        imported,
        request,
        confirm,
        resolved,
        text,
    })
}

/// The confirmations of the study. With a profile or options it is another study, which confirms nothing.
fn confirmed(
    text: &StudyText,
    root: &Node,
    sections: &Sections<'_>,
    (request, plan): (&Request, &SeedPlan),
) -> Result<Vec<Confirmation>, Vec<Diagnostic>> {
    if !sections.is_as_written {
        return Ok(Vec::new());
    }
    let searched = sections.searches.iter().flat_map(|it| &it.search.seeds);
    let used: Vec<u64> = plan.seeds.iter().chain(searched).copied().collect();
    let judged = (&request.claims[..], &request.tables[..]);
    confirmations::rounds(&text.confirm, root, judged, &used, sections.sources)
}

/// Reports a seed that a search shares with the study: the chosen setting is measured on other seeds than those by
/// which it was chosen.
fn searched_seed(root: &Node, sections: &Sections<'_>, plan: &SeedPlan) -> Option<Diagnostic> {
    let entry = root.entry("seeds")?;
    let used = |it: &search::LocatedSearch<'_>| {
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

fn assemble(root: &Node, sections: &Sections<'_>, made: FinishedSections) -> Study {
    let FinishedSections {
        plan,
        cells,
        order,
        vocabulary,
        imported,
        request,
        confirm,
        resolved,
        text,
    } = made;
    let profiles = root.get("profiles").map_or(&[][..], Node::entries);
    let (searches, prepared) = (sections.searches.iter(), sections.written.prepared.iter());
    Study {
        name: text.study.0.unwrap_or_default(),
        title: text.title.0.unwrap_or_default(),
        source: text.source.0.unwrap_or_default(),
        family: text.family.0,
        summary: request.summary,
        answers: request.answers,
        deviations: text.deviations.0.unwrap_or_default(),
        environments: vocabulary.environments,
        agents: vocabulary.agents,
        resolved,
        plays: vocabulary.plays,
        seeds: plan.seeds,
        design: plan.design,
        success: text.success.0,
        paper_budget: text.request.paper_budget.0,
        floors: text.request.floors.0.unwrap_or_default(),
        relevance: text.request.relevance.0,
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
        searches: searches.map(search::LocatedSearch::unlocated).collect(),
        metrics: vocabulary.metrics,
        units: vocabulary.units,
        prepared: prepared.map(|entry| entry.name.clone()).collect(),
        cells,
        order,
        numerics: sections.registry.numerics_version,
        folder: sections.folder.to_path_buf(),
        included: Vec::new(),
        confirm,
    }
}

/// Reports a limit that its schema allows and that limits nothing or everything.
fn wrong_limits(root: &Node, text: &StudyText, sources: &Sources) -> Option<Diagnostic> {
    let LimitError { key, value, instead } = text.limits.0.as_ref()?.check().err()?;
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

/// Whether trials cannot be made before the mistake is corrected. Mistakes in tables, figures and claims do not hide
/// others.
fn blocks_trials(diagnostic: &Diagnostic) -> bool {
    const SHOWN: [&str; 15] = [
        "answers",
        "confirm",
        "family",
        "title",
        "source",
        "summary",
        "deviations",
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
