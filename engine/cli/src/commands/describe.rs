//! `list`, `describe` and `schema`: the names that a study may use, for people, programs and editors.

use super::{Common, Format, say};
use crate::describe::{self, FORMAT, FitOptions, Group, markdown, text};
use clap::Args;
use contract::{Error, Registry};
use execution::{store::write_durably, world::fs};
use serde_json::{Value, json};
use session::{Exit, Failure};
use std::path::{Path, PathBuf};

/// Number of rows of a batch in a printed plan, if the protocol sets the batch size.
const ROWS: usize = 256;

/// Lists names with a line each.
pub(super) fn list(registry: &Registry, group: Option<Group>, common: &Common) -> Result<Exit, Failure> {
    let groups = group.map_or_else(|| Group::ALL.to_vec(), |group| vec![group]);
    let lists: Vec<_> = groups
        .into_iter()
        .map(|group| (group.word(), group.entries(registry)))
        .collect();
    if common.format == Format::Json {
        let object = lists.iter().map(|(word, entries)| {
            let entries = entries
                .iter()
                .map(|(name, about)| json!({"name": name, "about": about}))
                .collect();
            (word.clone(), Value::Array(entries))
        });
        say(&Value::Object(object.collect()).to_string());
        return Ok(Exit::Ok);
    }
    for (word, entries) in lists {
        let width = entries.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
        let lines = entries
            .iter()
            .map(|(name, about)| format!("  {name:<width$}  {about}"))
            .collect::<Vec<_>>()
            .join("\n");
        say(&format!("{word}\n{lines}"));
    }
    Ok(Exit::Ok)
}

/// Options of `describe`.
#[derive(Debug, Args)]
pub(super) struct DescribeOptions {
    /// An environment, agent, protocol, kind of table or figure, section of a study, sampler, relation, aggregate,
    /// artifact or executor; lists all of them where absent.
    name: Option<String>,
    /// Also list the agents or environments that do not fit, and the reasons.
    #[arg(long)]
    why: bool,
    /// Print the operations of one update of the agent in this environment instead, with defaults of both: their order,
    /// shapes, number and memory traffic.
    #[arg(long, value_name = "ENVIRONMENT", requires = "name", conflicts_with = "why")]
    plan: Option<String>,
    /// Write the reference into a folder instead: one Markdown page for each group of names.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["name", "why"])]
    pages: Option<PathBuf>,
}

/// Describes a name, prints a plan, or writes the reference.
pub(super) fn answer(
    registry: &Registry,
    options: &DescribeOptions,
    common: &Common,
) -> Result<Exit, Failure> {
    let DescribeOptions {
        name,
        why,
        plan,
        pages,
    } = options;
    match (pages, name, plan) {
        (Some(folder), ..) => write_pages(registry, folder),
        (_, Some(agent), Some(environment)) => print_plan(registry, agent, environment),
        _ => describe(registry, name.as_deref(), *why, common),
    }
}

/// Describes a name; without one, lists the names that can be described.
fn describe(registry: &Registry, name: Option<&str>, why: bool, common: &Common) -> Result<Exit, Failure> {
    let Some(name) = name else {
        say(&match common.format {
            Format::Text => text::overview(registry),
            Format::Json => groups(registry).to_string(),
        });
        return Ok(Exit::Ok);
    };
    let found = describe::find(registry, name, FitOptions { fits: true, why }).map_err(Failure::refusal)?;
    say(&match common.format {
        Format::Text => text::write(&found),
        Format::Json => format!("{:#}", json!({ "format": FORMAT, "found": found })),
    });
    Ok(Exit::Ok)
}

/// Prints the plan of one update of an agent in an environment, with the defaults of both.
fn print_plan(registry: &Registry, agent: &str, environment: &str) -> Result<Exit, Failure> {
    let unknown = |group: Group, name: &str| {
        let help = format!("`regimen list {}` lists them", group.word());
        Failure::refusal(format!(
            "there is no `{name}` among the {}\nhelp: {help}",
            group.word()
        ))
    };
    let learner = registry
        .agents
        .get(agent)
        .ok_or_else(|| unknown(Group::Agents, agent))?;
    let world = registry.environments.get(environment);
    let world = world.ok_or_else(|| unknown(Group::Environments, environment))?;
    let interface = (world.build)(&world.about.defaults)?.interface();
    let mut rng = contract::random::stream(&["plan"]);
    let plan = (learner.build)(&learner.about.defaults, &interface, &mut rng)?.plan(ROWS);
    let none = || {
        let why = "it does not learn by a plan of operations";
        Failure::refusal(format!("`{agent}` has no plan to print: {why}"))
    };
    say(&plan.ok_or_else(none)?);
    Ok(Exit::Ok)
}

/// The names that can be described, as data.
fn groups(registry: &Registry) -> Value {
    let groups = Group::ALL.map(|group| (group.word(), json!(describe::names(registry, group))));
    json!({ "format": FORMAT, "groups": Value::Object(groups.into_iter().collect()) })
}

/// Writes the reference, a page for each group of names.
fn write_pages(registry: &Registry, folder: &Path) -> Result<Exit, Failure> {
    fs::create_dir_all(folder).map_err(Error::file("create", folder))?;
    for page in markdown::pages(registry) {
        write_durably(&folder.join(&page.file), page.text.as_bytes())?;
    }
    say(&format!("the reference lies in `{}`", folder.display()));
    Ok(Exit::Ok)
}

/// Prints the JSON Schema of a study, for editors.
pub(super) fn schema(registry: &Registry) -> Result<Exit, Failure> {
    say(&format!("{:#}", study::for_editors(study::json_schema(registry))));
    Ok(Exit::Ok)
}
