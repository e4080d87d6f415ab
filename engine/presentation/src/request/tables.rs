//! Checks tables against the names that trials record: their parts, published values and margins.

use crate::{
    kinds::Readable,
    names::{Names, Place},
    table::{Cause, Margin, PublishedCell, PublishedRow, PublishedValue, StatedMargin, Table, TableSpec},
};
use document::{
    Entry,
    diagnostic::{Span, suggest},
};
use serde_json::{Map, Value};
use std::path::Path;

impl Names<'_> {
    /// Reads a table and checks every name in it; `None` if it has no kind or cannot be read, after a diagnostic.
    pub(super) fn table(
        &mut self,
        (keys, entry): (Option<&Map<String, Value>>, &Entry),
        kinds: &[Readable<dyn Table>],
        folder: &Path,
    ) -> Option<TableSpec> {
        let place = Place::of(entry, format!("tables.{}", entry.key));
        self.shown.entry(entry.key.clone()).or_default();
        let what = format!("the table `{}`", entry.key);
        let (mut spec, kind) = self.kind::<TableSpec, _>(keys?, (&what, &place), kinds, folder)?;
        spec.kind = kind;
        spec.published_curves
            .iter_mut()
            .for_each(|curve| curve.seek_from(folder));
        let inner = place.below(spec.kind.name)?;
        let (rows, columns) = spec.kind.check(self, &inner, place.below("published").as_ref());
        self.margin(&spec, &place);
        self.compared_curves(&spec, &place);
        for (row, published) in &spec.published {
            self.published(row, published, &rows, &columns, &place);
            self.judgeable(&spec, row, published, &place);
        }
        self.of_means(&spec, &place);
        self.caused(&spec, &rows, &place);
        self.typeset(&spec, &columns, &place);
        self.shown.insert(entry.key.clone(), (rows, columns));
        Some(spec)
    }

    /// Checks that values beside published ones are means over seeds, since verdicts are based on means.
    fn of_means(&mut self, spec: &TableSpec, place: &Place<'_>) {
        let (Some(shown), Some(inner)) = (spec.kind.no_means(), place.below("published")) else {
            return;
        };
        if !spec.published.is_empty() {
            let message = format!(
                "published values are compared with means over seeds, and this table shows the {shown}"
            );
            let help = "put them into a `comparison` without `statistic`";
            self.say((inner.key, inner.at), message, help);
        }
    }

    /// Checks that bold best values have a direction.
    fn typeset(&mut self, spec: &TableSpec, columns: &[String], place: &Place<'_>) {
        let (Some(layout), Some(inner)) = (&spec.latex, place.below("latex")) else {
            return;
        };
        let is_known = !columns.is_empty() && columns.iter().all(|column| spec.kind.better(column).is_some());
        if layout.bold_best && layout.better.is_none() && !is_known {
            self.say(
                inner.value("bold_best"),
                "nothing is best where it is not said which values are better",
                "add `better: higher` or `better: lower`",
            );
        }
        for key in ["better", "best_of"] {
            if !layout.bold_best && inner.node.entry(key).is_some() {
                let message = format!("`{key}` has no effect without `bold_best: true`");
                self.say(inner.value(key), message, "");
            }
        }
    }

    fn published(
        &mut self,
        row: &str,
        published: &PublishedRow,
        rows: &[String],
        columns: &[String],
        place: &Place<'_>,
    ) {
        let Some(section) = place.below("published") else {
            return;
        };
        let Some(inner) = section.below(row) else { return };
        if !rows.iter().any(|known| known == row) {
            let message = format!("no trial feeds the row `{row}` of published values");
            self.say(
                (inner.key, inner.at.clone()),
                message,
                suggest(row, rows.iter().map(String::as_str)),
            );
        }
        let PublishedRow::Columns(values) = published else {
            return;
        };
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

    /// Checks that published curves are compared at steps, with the row of an agent.
    fn compared_curves(&mut self, spec: &TableSpec, place: &Place<'_>) {
        let Some(list) = place.below("published_curves") else {
            return;
        };
        if spec.kind.measurements_by_step().is_none() {
            let message = "published curves are compared at steps, but the table has none";
            self.say(
                (list.key, list.at.clone()),
                message,
                "make it a `comparison` with `rows: agent` and `at_steps`",
            );
        }
        let all = self.all();
        for (curve, place) in spec.published_curves.iter().zip(list.items()) {
            if curve.agent.is_none() {
                self.say(
                    (place.key, place.at.clone()),
                    "`agent` is missing: it names the row",
                    "",
                );
            }
            self.curve(curve, &place, &all);
        }
    }

    /// Checks that a cause is given only for a table with published values, since only these can differ.
    fn caused(&mut self, spec: &TableSpec, rows: &[String], place: &Place<'_>) {
        let (Some(cause), Some(inner)) = (&spec.cause, place.below("cause")) else {
            return;
        };
        let published: Vec<&str> = if spec.published_curves.is_empty() {
            spec.published.keys().map(String::as_str).collect()
        } else {
            rows.iter().map(String::as_str).collect()
        };
        if published.is_empty() {
            let message = "the table has no published values, so nothing can differ and its cause is never \
                           printed";
            return self.say(
                (inner.key, inner.at),
                message,
                "give published values, or remove the cause",
            );
        }
        let Cause::ByRow(causes) = cause else { return };
        for row in causes.keys().filter(|row| !published.contains(&row.as_str())) {
            let key = inner.node.entry(row).map_or(inner.key, |entry| entry.key_span);
            let message = format!("nothing is published of a row `{row}`, so its cause is never printed");
            let help = suggest(row, published.iter().copied());
            self.say((key, format!("{}.{row}", inner.at)), message, help);
        }
    }

    /// Checks that a margin is on one scale.
    fn margin(&mut self, spec: &TableSpec, place: &Place<'_>) {
        let Some(Margin::Stated(StatedMargin {
            absolute,
            percent,
            ratio,
            ..
        })) = &spec.margin
        else {
            return;
        };
        let given: Vec<&str> = [("absolute", absolute), ("percent", percent), ("ratio", ratio)]
            .into_iter()
            .filter_map(|(scale, value)| value.map(|_| scale))
            .collect();
        let Some(inner) = place.below("margin").filter(|_| given.len() != 1) else {
            return;
        };
        let message = match given.as_slice() {
            [] => "the margin has no scale".to_owned(),
            several => format!(
                "the margin has {} scales, {}",
                several.len(),
                several.join(" and ")
            ),
        };
        self.say(
            (inner.key, inner.at.clone()),
            message,
            "give exactly one of `absolute`, `percent` and `ratio`",
        );
    }

    /// Checks that published values can be judged: a margin of zero can never be met, and a standard deviation needs
    /// a number of runs.
    fn judgeable(&mut self, spec: &TableSpec, row: &str, published: &PublishedRow, place: &Place<'_>) {
        let Some(inner) = place.below("published").and_then(|section| section.below(row)) else {
            return;
        };
        let below = |column: &str| {
            let at = format!("{}.{column}", inner.at);
            (
                inner.node.entry(column).map_or(inner.key, |entry| entry.key_span),
                at,
            )
        };
        let entries: Vec<(PublishedValue, (Span, String))> = match published {
            PublishedRow::Value(value) => vec![(
                PublishedCell::Value(*value).entry(),
                (inner.key, inner.at.clone()),
            )],
            PublishedRow::Entry(entry) => vec![(entry.clone(), (inner.key, inner.at.clone()))],
            PublishedRow::Columns(columns) => columns
                .iter()
                .map(|(name, cell)| (cell.entry(), below(name)))
                .collect(),
        };
        for (entry, at) in entries {
            self.spread(&entry, &at);
            if spec.kind.shows_shares() && entry.n.is_some() {
                self.share(&entry, at.clone());
            } else if entry.sd.is_some() != entry.n.is_some() {
                let message = "`sd` and `n` belong together: one alone does not say how uncertain the \
                               published value is";
                self.say(at.clone(), message, "give both or neither");
            }
            let (low, high) = Margin::band(spec.margin.as_ref(), entry.value);
            if low >= high && entry.calibrated_on.is_none() {
                let message = format!(
                    "the margin around {} is nothing, so that it can never count as reproduced",
                    entry.value
                );
                self.say(
                    at,
                    message,
                    "give the table a margin: `margin: { absolute: VALUE, why: TEXT }`",
                );
            }
        }
    }

    /// Checks that a spread is that of at least two runs.
    fn spread(&mut self, entry: &PublishedValue, at: &(Span, String)) {
        let Some(sd) = entry.sd else { return };
        if sd.is_nan() || sd < 0.0 {
            self.say(at.clone(), format!("`sd` is {sd}, but must be at least 0"), "");
        }
        if let Some(n) = entry.n.filter(|n| *n < 2) {
            let message = format!("`n` is {n}, but must be at least 2: fewer runs have no spread");
            self.say(
                at.clone(),
                message,
                "leave `sd` and `n` out, so that the value counts as exact",
            );
        }
    }

    /// Checks that a published share is possible for its number of runs, and has no spread, which would follow from the
    /// share.
    fn share(&mut self, entry: &PublishedValue, at: (Span, String)) {
        let n = entry.n.unwrap_or(1);
        if entry.sd.is_some() {
            let message = "a share has no `sd` of its own: it follows from `value` and `n`";
            self.say(at, message, "leave `sd` out");
        } else if entry.share().is_none() {
            let nearest = (entry.value * f64::from(n)).round().clamp(0.0, f64::from(n));
            let message = format!("{} is no share of {n} runs", entry.value);
            let help = format!("the nearest is {:.3}, {nearest} of {n}", nearest / f64::from(n));
            self.say(at, message, help);
        }
    }
}
