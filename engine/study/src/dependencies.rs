//! Dependencies between cells: the entries that configs name by `{ from: NAME }`, found among the cells of the study.

use super::{
    cell::{Cell, Place, Source},
    cells::Cells,
    checked_sections::Sections,
    config::locate,
    part::ResolvedPart,
    written::Target,
};
use contract::artifact::{Reference, named_in};
use document::diagnostic::{Diagnostic, Span, say_once, suggest};
use std::{collections::BTreeMap, sync::Arc};

/// Finds the artifacts that every cell takes, and returns an order in which each cell comes after its sources.
///
/// # Errors
/// Unknown names, names that mean several cells, seeds that do not run, and cells that depend on themselves.
pub fn link(
    sections: &Sections<'_>,
    cells: Cells,
    seeds: &[u64],
) -> Result<(Cells, Vec<usize>), Vec<Diagnostic>> {
    let mut found = Vec::new();
    let mut all: BTreeMap<usize, Arc<[Source]>> = BTreeMap::new();
    for index in cells.naming() {
        let mut reader = SourceReader {
            sections,
            cells: &cells,
            seeds,
            cell: cells.at(index),
            found: Vec::new(),
        };
        let sources = reader.sources();
        reader.found.into_iter().for_each(|it| say_once(&mut found, it));
        if sources.is_empty() {
            continue;
        }
        // Neighbouring cells mostly take the same artifacts.
        let shared = all.last_key_value().filter(|(_, before)| before[..] == sources);
        let sources = shared.map_or_else(|| sources.into(), |(_, before)| Arc::clone(before));
        all.insert(index, sources);
    }
    if !found.is_empty() {
        return Err(found);
    }
    let cells = cells.taking(all);
    let order = in_order(sections, &cells)?;
    Ok((cells, order))
}

struct SourceReader<'a> {
    sections: &'a Sections<'a>,
    cells: &'a Cells,
    seeds: &'a [u64],
    cell: Cell,
    found: Vec<Diagnostic>,
}

impl SourceReader<'_> {
    fn sources(&mut self) -> Vec<Source> {
        let mut sources = Vec::new();
        for part in 0..self.cell.parts.len() {
            let shared = self.cell.parts[part].part.config.clone();
            let config = shared.whole();
            for (pointer, (kind, reference)) in named_in(&config) {
                let place = NamedArtifact {
                    part,
                    pointer: &pointer,
                    reference: &reference,
                };
                if let Some(cell) = self.cell_of(&place).filter(|cell| self.has_seed(&place, *cell)) {
                    sources.push(Source {
                        part,
                        pointer,
                        kind,
                        cell,
                        seed: reference.seed,
                    });
                }
            }
        }
        sources
    }

    /// The cell from which this cell continues, in the schedule of a population.
    fn stretch_before(&self) -> Option<usize> {
        let (search, place) = self.cell.tried()?;
        let before = Some((search, self.sections.searches[search].parent(place)?));
        let place = match self.cell.place {
            Place::Combination(environment, agent) => Place::Leading(environment, agent),
            of_its_kind => of_its_kind,
        };
        let is_before = |cell: &Cell| cell.place == place && cell.tried() == before;
        self.cells.other(is_before)
    }

    fn cell_of(&mut self, named: &NamedArtifact<'_>) -> Option<usize> {
        let protocol = &self.cell.parts[2].given;
        if named.part == 2 && protocol.stretch.is_some_and(|it| it.goes_on) && named.pointer == "/go_on_from"
        {
            return self.stretch_before();
        }
        let Reference {
            from, environment, ..
        } = named.reference;
        let written = self.sections.written;
        if let Some(entry) = written.prepared.iter().position(|entry| entry.name == *from) {
            if environment.is_some() {
                let message = format!("`{from}` is an entry of `prepare` and has one environment");
                self.say(named, "environment", message, "leave `environment` out");
                return None;
            }
            return self.cells.other(|cell| cell.place == Place::Prepared(entry));
        }
        let Some(agent) = written.agents.iter().position(|it| it.name == *from) else {
            let known = written
                .prepared
                .iter()
                .map(|it| it.name.as_str())
                .chain(written.agents.iter().map(|it| it.name.as_str()));
            let help = suggest(from, known);
            self.say(
                named,
                "from",
                format!("no entry of `prepare` and no agent is named `{from}`"),
                help,
            );
            return None;
        };
        let environment = self.environment(named, environment.as_deref())?;
        self.only_cell(named, environment, agent)
    }

    /// The environment in which an agent was trained: the named one, or that of the cell itself.
    fn environment(&mut self, named: &NamedArtifact<'_>, name: Option<&str>) -> Option<usize> {
        let known = &self.sections.written.environments;
        let own = match self.cell.parts[0].given.target {
            Target::Environment(index) => Some(index),
            _ => None,
        };
        let Some(name) = name else {
            if own.is_none() {
                let help = suggest("", known.iter().map(|it| it.name.as_str()));
                self.say(
                    named,
                    "from",
                    format!(
                        "`{}` was trained in an environment that is not said",
                        named.reference.from
                    ),
                    help,
                );
            }
            return own;
        };
        let found = known.iter().position(|it| it.name == name);
        if found.is_none() {
            let help = suggest(name, known.iter().map(|it| it.name.as_str()));
            self.say(
                named,
                "environment",
                format!("no environment is named `{name}`"),
                help,
            );
        }
        found
    }

    fn only_cell(&mut self, named: &NamedArtifact<'_>, environment: usize, agent: usize) -> Option<usize> {
        let found = self.cells.of_pair((environment, agent));
        let written = self.sections.written;
        let (place, agent) = (
            &written.environments[environment].name,
            &written.agents[agent].name,
        );
        match found.len() {
            1 => return Some(found.start),
            0 => {
                let message =
                    format!("no trial runs `{agent}` in `{place}`, so that nothing can be taken from there");
                self.say(named, "from", message, "`exclude` leaves out this combination");
            }
            several => {
                let message =
                    format!("`{agent}` has {several} settings in `{place}`, and each leaves something else");
                self.say(
                    named,
                    "from",
                    message,
                    "give each setting a name of its own under `agents` instead of a sweep",
                );
            }
        }
        None
    }

    /// Whether a cell runs the named seed: a combination runs the seeds of the study, and an entry of `prepare` runs
    /// those that are asked for.
    fn has_seed(&mut self, named: &NamedArtifact<'_>, cell: usize) -> bool {
        let Some(seed) = named.reference.seed.filter(|seed| !self.seeds.contains(seed)) else {
            return true;
        };
        if self.cells.place(cell).pair().is_none() {
            return true;
        }
        let message = format!("the study does not run seed {seed} of `{}`", named.reference.from);
        self.say(
            named,
            "seed",
            message,
            "take one of its `seeds`, or leave `seed` out: seed k then takes from seed k",
        );
        false
    }

    fn say(
        &mut self,
        named: &NamedArtifact<'_>,
        key: &str,
        message: impl Into<String>,
        help: impl Into<String>,
    ) {
        let (span, at) = place(self.sections, &self.cell.parts[named.part], named.pointer, key);
        let error = self.sections.sources.error(span, &at, message);
        let help = help.into();
        let error = if help.is_empty() { error } else { error.help(help) };
        // Cells that share a part share its mistakes.
        if !self.found.contains(&error) {
            self.found.push(error);
        }
    }
}

/// An artifact as a config names it.
struct NamedArtifact<'a> {
    part: usize,
    pointer: &'a str,
    reference: &'a Reference,
}

/// Position of a key of an artifact, and its dotted path.
pub fn place(sections: &Sections<'_>, part: &ResolvedPart, pointer: &str, key: &str) -> (Span, String) {
    let dotted = |words: &[&str]| {
        words
            .iter()
            .filter(|word| !word.is_empty())
            .copied()
            .collect::<Vec<_>>()
            .join(".")
    };
    let below = pointer.trim_start_matches('/').replace('/', ".");
    let given = sections.assigned(&part.given);
    let (at, plugin) = sections
        .plugin(part.given.target)
        .map_or_else(Default::default, |plugin| (plugin.at, plugin.span));
    (
        locate(&given, &dotted(&[&below, key])).unwrap_or(plugin),
        dotted(&[&at, &below, key]),
    )
}

/// Indices of the cells, each after the cells from which it takes artifacts.
fn in_order(sections: &Sections<'_>, cells: &Cells) -> Result<Vec<usize>, Vec<Diagnostic>> {
    let mut order = Order {
        cells,
        done: vec![false; cells.len()],
        way: Vec::new(),
        order: Vec::with_capacity(cells.len()),
    };
    for index in 0..cells.len() {
        if let Err((cell, source)) = order.visit(index) {
            let cell = cells.at(cell);
            let source = &cell.sources[source];
            let (span, at) = place(sections, &cell.parts[source.part], &source.pointer, "from");
            let way: Vec<String> = order
                .way
                .iter()
                .map(|index| format!("`{}`", name(sections, cells.place(*index))))
                .collect();
            let message = format!(
                "this makes a circle: {} takes from itself",
                way.join(" takes from ")
            );
            return Err(vec![
                sections
                    .sources
                    .error(span, &at, message)
                    .help("a trial can take only from trials that end before it begins"),
            ]);
        }
    }
    Ok(order.order)
}

/// A depth-first search that keeps the path to its current cell.
struct Order<'a> {
    cells: &'a Cells,
    done: Vec<bool>,
    way: Vec<usize>,
    order: Vec<usize>,
}

impl Order<'_> {
    /// Appends a cell after its sources. The error is the cell and the source that close a circle, with `way` left at
    /// the circle.
    fn visit(&mut self, index: usize) -> Result<(), (usize, usize)> {
        if self.done[index] {
            return Ok(());
        }
        self.way.push(index);
        let cells = self.cells;
        for (number, source) in cells.sources(index).iter().enumerate() {
            if let Some(start) = self.way.iter().position(|on_way| *on_way == source.cell) {
                self.way.drain(..start);
                return Err((index, number));
            }
            self.visit(source.cell)?;
        }
        self.way.pop();
        self.done[index] = true;
        self.order.push(index);
        Ok(())
    }
}

/// Name of a cell in messages.
pub fn name(sections: &Sections<'_>, place: Place) -> String {
    let written = sections.written;
    match place {
        Place::Prepared(index) => written.prepared[index].name.clone(),
        Place::Tried(index) => sections.searches[index].search.name.clone(),
        Place::Combination(environment, agent) | Place::Leading(environment, agent) => {
            format!(
                "{} in {}",
                written.agents[agent].name, written.environments[environment].name
            )
        }
    }
}
