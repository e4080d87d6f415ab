//! Checks comparisons against the names that trials record: metrics, agents, rows and columns.

use super::{Axis, Comparison, Form, TableAxis, taken::MeasurementChoice};
use crate::names::{Names, Picked, Place, quoted};
use contract::standard_metrics::SUCCESS;
use document::diagnostic::suggest;

/// Checks a comparison; returns the names of its rows and columns.
pub(super) fn comparison(
    spec: &Comparison,
    names: &mut Names<'_>,
    place: &Place<'_>,
) -> (Vec<String>, Vec<String>) {
    let picked = names.pick(place);
    names.metric(&spec.value, place, "value", &picked);
    match &spec.relative_to {
        Some(other) => reference(other, &spec.value, names, place, &picked),
        None if is_relative(spec) => without_reference(names, place),
        None => {}
    }
    if let Some(pair) = spec.at_steps.windows(2).find(|pair| pair[0] >= pair[1]) {
        let message = format!("steps must rise, {} follows {}", pair[1], pair[0]);
        names.say(place.value("at_steps"), message, "");
    }
    of_success(spec, names, place, &picked);
    axes(spec, names, place);
    let rows = spec.rows.places(names, &picked);
    let columns = columns(spec, names, &picked);
    names.labels(place, &rows, &columns);
    (rows, columns)
}

/// Whether a comparison is written relative to an agent.
pub(super) fn is_relative(spec: &Comparison) -> bool {
    matches!(
        spec.form,
        Some(Form::Difference | Form::Ratio | Form::PercentChange)
    )
}

/// Reports that the agent to compare with is missing.
pub(super) fn without_reference(names: &mut Names<'_>, place: &Place<'_>) {
    let message = "`relative_to` is missing: this compares agents with one of them";
    let help = format!("agents: {}", quoted(&names.vocabulary.agents));
    names.say((place.key, place.at.clone()), message, help);
}

/// Checks the agent that others are compared with: it has trials here, and they record the metric.
fn reference(name: &str, metric: &str, names: &mut Names<'_>, place: &Place<'_>, picked: &Picked) {
    let Some(index) = names.vocabulary.agents.iter().position(|known| known == name) else {
        let help = suggest(name, names.vocabulary.agents.iter().map(String::as_str));
        return names.say(
            place.value("relative_to"),
            format!("no agent is named `{name}`"),
            help,
        );
    };
    let recorded = names.recorded(&Picked {
        agents: vec![index],
        environments: picked.environments.clone(),
    });
    if recorded.is_empty() {
        let message = format!("no trial feeds the agent `{name}` here");
        names.say(
            place.value("relative_to"),
            message,
            "`exclude` leaves out its combinations with these environments",
        );
    } else if !recorded.contains(metric) && names.recorded(picked).contains(metric) {
        let message = format!("`{name}` does not record `{metric}`, so nothing can be compared with it");
        names.say(place.value("relative_to"), message, "");
    }
}

/// Checks a comparison of success: it is judged at the end, and only if the study defines success.
fn of_success(spec: &Comparison, names: &mut Names<'_>, place: &Place<'_>, picked: &Picked) {
    if spec.given_success && !names.recorded(picked).contains(SUCCESS) {
        let message = "`given_success` needs a section `success`: the study does not say what a success is";
        names.say(
            place.value("given_success"),
            message,
            "write `success: { metric: METRIC, above: VALUE }`",
        );
    }
    if spec.value != SUCCESS {
        return;
    }
    if spec.given_success {
        names.say(
            place.value("given_success"),
            "the share of successes among successes is 1",
            "remove one of the two",
        );
    }
    let while_learning = match spec.taken() {
        MeasurementChoice::Final => None,
        MeasurementChoice::RootMeanSquare => Some("root_mean_square"),
        MeasurementChoice::Last(_) => Some("last"),
        MeasurementChoice::StepsUntilAbove { .. } => Some("steps_until_above"),
        MeasurementChoice::AtSteps { .. } => Some("at_steps"),
    };
    if let Some(key) = while_learning {
        let message = "`success` is judged by the final measurement, and by none during learning";
        names.say(place.value(key), message, format!("remove `{key}`"));
    }
    if matches!(spec.resolved_form(), Form::Ratio | Form::PercentChange) {
        let message = "a seed's `success` is 0 or 1, so that its ratio to another one means nothing";
        names.say(
            place.value("as"),
            message,
            "write `as: difference`, or compare the shares in a claim",
        );
    }
}

/// Checks that rows and columns are two different axes, and that settings are an axis only with a sweep.
fn axes(spec: &Comparison, names: &mut Names<'_>, place: &Place<'_>) {
    if spec.columns.as_ref() == Some(&spec.rows) {
        let help = "choose another of `agent`, `environment`, `setting`";
        names.say(place.value("columns"), "rows and columns are the same", help);
    }
    for (key, along) in [("rows", Some(&spec.rows)), ("columns", spec.columns.as_ref())] {
        if let Some(along) = along {
            along.check(key, names, place);
        }
    }
}

/// Names of the columns: the given steps or axis; otherwise the first of agent, environment and setting that varies and
/// is no row.
fn columns(spec: &Comparison, names: &Names<'_>, picked: &Picked) -> Vec<String> {
    if !spec.at_steps.is_empty() {
        return spec.at_steps.iter().map(u64::to_string).collect();
    }
    if let Some(along) = &spec.columns {
        return along.places(names, picked);
    }
    let rest = Axis::ALL
        .into_iter()
        .map(TableAxis::from)
        .filter(|along| *along != spec.rows);
    rest.map(|along| along.places(names, picked))
        .find(|names| names.len() > 1)
        .unwrap_or_default()
}
