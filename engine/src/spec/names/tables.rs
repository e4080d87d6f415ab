//! Tables against what trials record: metrics, rows, columns, published values.

use super::{Names, Picked, Place, quoted};
use crate::{
    diagnostic::{Span, suggest},
    document::Entry,
    results::SUCCESS,
    table::{
        Axis, Comparison, CrossPlayTable, Form, KINDS, MEAN, Margin, Published, PublishedCell, PublishedValue, StatedMargin,
        TableSpec,
    },
};

impl Names<'_> {
    /// Checks every name in a table.
    pub(super) fn table(&mut self, spec: &TableSpec, entry: &Entry) {
        let place = Place::of(entry, format!("tables.{}", entry.key));
        let comparison = spec.improvement.as_ref().or(spec.comparison.as_ref());
        let kinds = [spec.improvement.is_some(), spec.comparison.is_some(), spec.cross_play.is_some(), spec.aggregate.is_some()];
        let given: Vec<&str> = KINDS.into_iter().zip(kinds).filter(|(_, given)| *given).map(|(kind, _)| kind).collect();
        let [kind] = given.as_slice() else {
            return self.one_kind(&format!("the table `{}`", entry.key), &place, &given, &quoted(&KINDS.map(String::from)));
        };
        let Some(inner) = place.below(kind) else { return };
        let (rows, columns) = match (comparison, &spec.cross_play, &spec.aggregate) {
            (Some(comparison), ..) => self.comparison(comparison, &inner, *kind == "improvement"),
            (None, Some(matrix), _) => self.matrix(matrix, &inner),
            (None, None, Some(suite)) => self.aggregate(suite, &inner, place.below("published").as_ref()),
            (None, None, None) => return,
        };
        self.margin(spec, &place);
        self.compared_curves(spec, &place);
        for (row, published) in &spec.published {
            self.published(row, published, &rows, &columns, &place);
            self.judgeable(spec.margin.as_ref(), row, published, &place);
        }
    }

    /// Checks the matrix of a play; returns the names of its rows and columns.
    fn matrix(&mut self, spec: &CrossPlayTable, place: &Place<'_>) -> (Vec<String>, Vec<String>) {
        let world = self.world;
        let Some(play) = world.plays.iter().find(|play| play.name == spec.play) else {
            let help = suggest(&spec.play, world.plays.iter().map(|play| play.name.as_str()));
            self.say(place.value("play"), format!("no play is named `{}`", spec.play), help);
            return (Vec::new(), Vec::new());
        };
        for (key, role) in [("rows", &spec.rows), ("columns", &spec.columns)] {
            if !play.roles.iter().any(|(known, _)| known == role) {
                let help = suggest(role, play.roles.iter().map(|(known, _)| known.as_str()));
                self.say(place.value(key), format!("`{}` has no role `{role}`", play.name), help);
            }
        }
        if spec.rows == spec.columns {
            self.say(place.value("columns"), "rows and columns are the same role", "choose another role");
        }
        if !play.metrics.contains(&spec.value) {
            self.unknown_metric(&spec.value, place.value("value"), &play.metrics);
        }
        let players = play.players.iter().map(|player| player.name.clone());
        let names: Vec<String> = players.chain([MEAN.to_owned()]).collect();
        let roles = [spec.rows.clone(), spec.columns.clone(), spec.value.clone()];
        self.labels(place, &names, &roles);
        (names.clone(), names)
    }

    /// Checks a comparison; returns the names of its rows and columns.
    pub(super) fn comparison(&mut self, spec: &Comparison, place: &Place<'_>, improvement: bool) -> (Vec<String>, Vec<String>) {
        let picked = self.pick(place);
        self.metric(&spec.value, place, "value", &picked);
        if let Some(other) = &spec.relative_to {
            self.reference(other, &spec.value, place, &picked);
        }
        let needs = improvement || matches!(spec.form, Some(Form::Difference | Form::Ratio | Form::PercentChange));
        if needs && spec.relative_to.is_none() {
            let message = "`relative_to` is missing: this compares agents with one of them";
            self.say((place.key, place.at.clone()), message, format!("agents: {}", quoted(&self.world.agents)));
        }
        self.while_learning(spec, place);
        self.of_success(spec, place, &picked);
        if spec.columns == Some(spec.rows) {
            self.say(
                place.value("columns"),
                "rows and columns are the same",
                "choose another of `agent`, `environment`, `setting`",
            );
        }
        let has_sweep = self.world.settings.iter().any(|setting| !setting.is_empty());
        for (key, axis) in [("rows", Some(spec.rows)), ("columns", spec.columns)] {
            if axis == Some(Axis::Setting) && !has_sweep {
                self.say(place.value(key), format!("`{key}` are settings, but the study has no `sweep`"), "");
            }
        }
        let rows = self.names_of(spec.rows, &picked);
        let columns = self.columns(spec, &picked);
        self.labels(place, &rows, &columns);
        (rows, columns)
    }

    /// Success is judged at the end, and only where the study says what it is.
    fn of_success(&mut self, spec: &Comparison, place: &Place<'_>, picked: &Picked) {
        if spec.given_success && !self.recorded(picked).contains(SUCCESS) {
            let message = "`given_success` needs a section `success`: the study does not say what a success is";
            self.say(place.value("given_success"), message, "write `success: { metric: METRIC, above: VALUE }`");
        }
        if spec.value == SUCCESS && spec.given_success {
            self.say(place.value("given_success"), "the share of successes among successes is 1", "remove one of the two");
        }
    }

    /// Checks that at most one value is asked of the measurements during learning.
    fn while_learning(&mut self, spec: &Comparison, place: &Place<'_>) {
        let over_steps = !spec.at_steps.is_empty();
        if spec.smooth.is_some() && spec.steps_until_above.is_none() && !over_steps {
            self.say(place.value("smooth"), "`smooth` has no effect without `steps_until_above` or `at_steps`", "");
        }
        let kinds = [
            ("at_steps", over_steps && spec.steps_until_above.is_some()),
            ("smooth", over_steps && spec.smooth.is_some() && spec.steps_until_above.is_none()),
            ("steps_until_above", spec.steps_until_above.is_some()),
            ("last", spec.last.is_some()),
        ];
        let given: Vec<&str> = kinds.into_iter().filter(|(_, given)| *given).map(|(kind, _)| kind).collect();
        if let [first, .., last] = given.as_slice() {
            let message = format!("`{last}` and `{first}` are two different values");
            self.say(place.value(last), message, "remove one of the two");
        }
        if over_steps && spec.columns.is_some() {
            self.say(place.value("columns"), "the steps of `at_steps` are the columns", "remove one of the two");
        }
        if let Some(pair) = spec.at_steps.windows(2).find(|pair| pair[0] >= pair[1]) {
            let message = format!("steps must rise, {} follows {}", pair[1], pair[0]);
            self.say(place.value("at_steps"), message, "");
        }
    }

    /// Checks the agent that others are compared with: it has trials here, and they record the metric.
    fn reference(&mut self, name: &str, metric: &str, place: &Place<'_>, picked: &Picked) {
        let Some(index) = self.world.agents.iter().position(|known| known == name) else {
            let help = suggest(name, self.world.agents.iter().map(String::as_str));
            return self.say(place.value("relative_to"), format!("no agent is named `{name}`"), help);
        };
        let recorded = self.recorded(&Picked { agents: vec![index], environments: picked.environments.clone() });
        if recorded.is_empty() {
            let message = format!("no trial feeds the agent `{name}` here");
            self.say(place.value("relative_to"), message, "`exclude` leaves out its combinations with these environments");
        } else if !recorded.contains(metric) && self.recorded(picked).contains(metric) {
            let message = format!("`{name}` does not record `{metric}`, so nothing can be compared with it");
            self.say(place.value("relative_to"), message, "");
        }
    }

    fn names_of(&self, axis: Axis, picked: &Picked) -> Vec<String> {
        match axis {
            Axis::Agent => picked.agents.iter().map(|index| self.world.agents[*index].clone()).collect(),
            Axis::Environment => picked.environments.iter().map(|index| self.world.environments[*index].clone()).collect(),
            Axis::Setting => self.world.settings.iter().filter(|setting| !setting.is_empty()).cloned().collect(),
        }
    }

    /// Names of the columns: the steps or the axis asked for, or the first of agent, environment and setting that varies and is no row.
    fn columns(&self, spec: &Comparison, picked: &Picked) -> Vec<String> {
        if !spec.at_steps.is_empty() {
            return spec.at_steps.iter().map(u64::to_string).collect();
        }
        if let Some(axis) = spec.columns {
            return self.names_of(axis, picked);
        }
        let rest = [Axis::Agent, Axis::Environment, Axis::Setting].into_iter().filter(|axis| *axis != spec.rows);
        rest.map(|axis| self.names_of(axis, picked)).find(|names| names.len() > 1).unwrap_or_default()
    }

    fn published(&mut self, row: &str, published: &Published, rows: &[String], columns: &[String], place: &Place<'_>) {
        let Some(section) = place.below("published") else { return };
        let Some(inner) = section.below(row) else { return };
        if !rows.iter().any(|known| known == row) {
            let message = format!("no trial feeds the row `{row}` of published values");
            self.say((inner.key, inner.at.clone()), message, suggest(row, rows.iter().map(String::as_str)));
        }
        let Published::Columns(values) = published else { return };
        for column in values.keys().filter(|column| !columns.contains(column)) {
            let span = inner.node.entry(column).map_or(inner.key, |entry| entry.key_span);
            let message = format!("no trial feeds the column `{column}` of published values");
            let help = if columns.is_empty() {
                format!("the table has one column: write `{row}: VALUE`")
            } else {
                suggest(column, columns.iter().map(String::as_str))
            };
            self.say((span, format!("{}.{column}", inner.at)), message, help);
        }
    }

    /// Published curves are compared at steps, with the row of an agent.
    fn compared_curves(&mut self, spec: &TableSpec, place: &Place<'_>) {
        let Some(list) = place.below("published_curves") else { return };
        if spec.comparison.as_ref().is_none_or(|comparison| comparison.at_steps.is_empty() || comparison.rows != Axis::Agent) {
            let message = "published curves are compared at steps, but the table has none";
            self.say((list.key, list.at.clone()), message, "make it a `comparison` with `rows: agent` and `at_steps`");
        }
        let all =
            Picked { agents: (0..self.world.agents.len()).collect(), environments: (0..self.world.environments.len()).collect() };
        for (index, (curve, node)) in spec.published_curves.iter().zip(list.node.items()).enumerate() {
            let place = Place { node, key: node.span, at: format!("{}[{index}]", list.at) };
            if curve.agent.is_none() {
                self.say((place.key, place.at.clone()), "`agent` is missing: it names the row", "");
            }
            self.curve(curve, &place, &all);
        }
    }

    /// A margin is on one scale.
    fn margin(&mut self, spec: &TableSpec, place: &Place<'_>) {
        let Some(Margin::Stated(StatedMargin { absolute, percent, ratio, .. })) = &spec.margin else { return };
        let given: Vec<&str> = [("absolute", absolute), ("percent", percent), ("ratio", ratio)]
            .into_iter()
            .filter_map(|(scale, value)| value.map(|_| scale))
            .collect();
        let Some(inner) = place.below("margin").filter(|_| given.len() != 1) else { return };
        let message = match given.as_slice() {
            [] => "the margin has no scale".to_owned(),
            several => format!("the margin has {} scales, {}", several.len(), several.join(" and ")),
        };
        self.say((inner.key, inner.at.clone()), message, "give exactly one of `absolute`, `percent` and `ratio`");
    }

    /// A margin of nothing can never be met, and a standard deviation means nothing without a number of runs.
    fn judgeable(&mut self, margin: Option<&Margin>, row: &str, published: &Published, place: &Place<'_>) {
        let Some(inner) = place.below("published").and_then(|section| section.below(row)) else { return };
        let below = |column: &str| {
            let at = format!("{}.{column}", inner.at);
            (inner.node.entry(column).map_or(inner.key, |entry| entry.key_span), at)
        };
        let entries: Vec<(PublishedValue, (Span, String))> = match published {
            Published::Value(value) => vec![(PublishedCell::Value(*value).entry(), (inner.key, inner.at.clone()))],
            Published::Entry(entry) => vec![(entry.clone(), (inner.key, inner.at.clone()))],
            Published::Columns(columns) => columns.iter().map(|(name, cell)| (cell.entry(), below(name))).collect(),
        };
        for (entry, at) in entries {
            if entry.sd.is_some() != entry.n.is_some() {
                let message = "`sd` and `n` belong together: one alone does not say how uncertain the published value is";
                self.say(at.clone(), message, "give both or neither");
            }
            let (low, high) = Margin::band(margin, entry.value);
            if low >= high && entry.calibrated_on.is_none() {
                let message = format!("the margin around {} is nothing, so that it can never count as reproduced", entry.value);
                self.say(at, message, "give the table a margin: `margin: { absolute: VALUE, why: TEXT }`");
            }
        }
    }

    pub(super) fn labels(&mut self, place: &Place<'_>, rows: &[String], columns: &[String]) {
        let Some(labels) = place.below("labels") else { return };
        let known: Vec<&str> = rows.iter().chain(columns).map(String::as_str).collect();
        for entry in labels.node.entries().iter().filter(|entry| !known.contains(&entry.key.as_str())) {
            let message = format!("`{}` is no row or column, so its label is never printed", entry.key);
            self.say(
                (entry.key_span, format!("{}.{}", labels.at, entry.key)),
                message,
                suggest(&entry.key, known.iter().copied()),
            );
        }
    }
}
