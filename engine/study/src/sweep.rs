//! Sweeps: from generators to the points of each dimension.
//!
//! Every `grid` key is a dimension of its own; all `zip` keys are one dimension, and all sampled keys are one. Samples
//! come from a stream named by the key alone, so a larger number keeps the earlier samples (except for
//! `latin_hypercube`, whose slices move).

use super::{
    path::{self, KeyPath},
    written::{Target, Written},
};
use analysis::search::Numbers;
use contract::random;
use document::{
    Entry, FittingEntries, Node,
    diagnostic::{Diagnostic, Sources, Span},
};
use presentation::vocabulary::SweptKey;
use rand::{Rng as _, seq::SliceRandom};
use schemars::JsonSchema;
use serde::Deserialize;
use serde_json::Value;
use std::{
    borrow::Cow,
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

/// A way to make the values of a swept key.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum Generator {
    /// Every combination of listed values.
    Grid(
        /// Values of which every combination is tried.
        ValueList,
    ),
    /// Listed values, key by key.
    Zip(
        /// Values that go together with those of the other `zip` keys, one by one.
        ValueList,
    ),
    /// Samples of a uniform distribution.
    Random(
        /// Samples spread evenly between two limits.
        Samples,
    ),
    /// Samples of a log-uniform distribution.
    LogUniform(
        /// Samples whose logarithm is spread evenly between two limits.
        Samples,
    ),
    /// Samples of a Latin hypercube.
    LatinHypercube(
        /// Samples with one in each of equally likely slices.
        SlicedSamples,
    ),
}

/// A value for each point.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(transparent)]
pub(super) struct ValueList(#[schemars(length(min = 1))] Vec<Value>);

/// Largest number of samples of a key; no samples are drawn if more are asked for.
const MOST_SAMPLES: usize = 100_000;

/// Samples between two limits.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Samples {
    /// Smallest value.
    low: f64,
    /// Largest value.
    high: f64,
    /// Number of samples.
    #[schemars(range(min = 1, max = 100_000))]
    samples: usize,
}

/// Samples between two limits, with one in each of equally likely slices.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct SlicedSamples {
    /// Smallest value.
    low: f64,
    /// Largest value.
    high: f64,
    /// Number of samples.
    #[schemars(range(min = 1, max = 100_000))]
    samples: usize,
    /// Spread the logarithm evenly.
    #[serde(default)]
    log: bool,
}

/// A swept key with its place in the study. It has a value at each point of its dimension.
#[derive(Debug, Clone)]
pub struct LocatedKey<'a> {
    /// The key and its values, as later stages read them.
    pub swept: Arc<SweptKey>,
    /// The key in the study.
    pub path: KeyPath<'a>,
    /// Position of each value; for samples, the position of the generator.
    spans: Vec<Span>,
}

impl LocatedKey<'_> {
    /// Writes the value of a point into the config of the key's part.
    pub(super) fn assign(&self, point: usize, config: &mut Node) {
        let value = Node::from_value(self.spans[point], &self.swept.values[point]);
        self.path.assign(config, &value);
    }

    /// Keeps the points for which `is_kept` is true.
    fn keep(&mut self, is_kept: &[bool]) {
        let own = self.swept.values.iter().zip(&self.spans).zip(is_kept);
        let kept = own.filter_map(|(point, is_kept)| is_kept.then_some(point));
        let (values, spans): (Vec<Value>, Vec<Span>) =
            kept.map(|(value, span)| (value.clone(), *span)).unzip();
        Arc::make_mut(&mut self.swept).values = values.into();
        self.spans = spans;
    }
}

/// Keys that change together.
#[derive(Debug, Clone)]
pub struct Dimension<'a> {
    /// The keys; all have the same number of values.
    pub keys: Vec<LocatedKey<'a>>,
    /// Number of points that were written or drawn; samples that gave the same setting are one point.
    pub drawn: usize,
}

impl Dimension<'_> {
    /// Number of points of the dimension.
    #[must_use]
    pub fn n_points(&self) -> usize {
        self.keys.first().map_or(0, |key| key.swept.values.len())
    }

    /// Keeps the first of the points that gave the same setting, which occur among samples of whole numbers.
    fn keep_different_points(&mut self) {
        let mut seen = BTreeSet::new();
        let is_new: Vec<bool> = (0..self.n_points())
            .map(|index| seen.insert(point(&self.keys, index)))
            .collect();
        if is_new.contains(&false) {
            self.keys.iter_mut().for_each(|key| key.keep(&is_new));
        }
    }

    /// Whether a key of this dimension belongs to one of the targets.
    #[must_use]
    pub fn concerns(&self, targets: &[Target]) -> bool {
        self.keys.iter().any(|key| targets.contains(&key.path.target))
    }
}

/// Reads the section `sweep`; keys that a profile or `--set` fixed are left out.
///
/// # Errors
/// Unknown paths, values that do not fit, and lists of unequal length.
pub fn read<'a>(
    root: &Node,
    generators: &FittingEntries<Generator>,
    written: &Written,
    schema: &'a Value,
    sources: &Sources,
    fixed: &[KeyPath<'_>],
) -> Result<Vec<Dimension<'a>>, Vec<Diagnostic>> {
    let (mut dimensions, mut groups, mut found) = (
        Vec::<Dimension<'a>>::new(),
        Vec::<(&str, usize)>::new(),
        Vec::new(),
    );
    for entry in root.get("sweep").map_or(&[][..], Node::entries) {
        let [generator] = entry.value.entries() else {
            continue;
        };
        let read = generators.get(&entry.key);
        let key = match swept_key(entry, (read, generator), written, schema, sources) {
            Ok(key) if fixed.iter().any(|fixed| fixed.overlaps(&key.path)) => continue,
            Ok(key) => key,
            Err(errors) => {
                found.extend(errors);
                continue;
            }
        };
        let group = match generator.key.as_str() {
            "grid" => None,
            "zip" => Some("zip"),
            _ => Some("samples"),
        };
        match group
            .and_then(|group| groups.iter().find(|(name, _)| *name == group))
            .copied()
        {
            Some((name, index)) => {
                found.extend(unequal(&dimensions[index].keys[0], &key, name, sources));
                dimensions[index].keys.push(key);
            }
            None => {
                groups.extend(group.map(|name| (name, dimensions.len())));
                dimensions.push(Dimension {
                    drawn: key.swept.values.len(),
                    keys: vec![key],
                });
            }
        }
    }
    found.extend(swept_twice(&dimensions, sources));
    found.extend(points_twice(&dimensions, sources));
    if !found.is_empty() {
        return Err(found);
    }
    dimensions.iter_mut().for_each(Dimension::keep_different_points);
    Ok(dimensions)
}

fn swept_key<'a>(
    entry: &Entry,
    generator: (Option<&Generator>, &Entry),
    written: &Written,
    schema: &'a Value,
    sources: &Sources,
) -> Result<LocatedKey<'a>, Vec<Diagnostic>> {
    let at = format!("sweep.{}", entry.key);
    let path = path::find(&entry.key, entry.key_span, &at, written, schema, sources)?;
    if let Some((message, help)) = not_swept(&path) {
        return Err(vec![sources.error(entry.key_span, &at, message).help(help)]);
    }
    let (values, nodes) = values(generator, &path, &at, sources).map_err(|error| vec![*error])?;
    let wrong: Vec<Diagnostic> = nodes
        .iter()
        .flat_map(|node| path.check(node, &at, sources))
        .take(1)
        .collect();
    if wrong.is_empty() {
        let swept = SweptKey {
            key: entry.key.as_str().into(),
            agent: match path.target {
                Target::Agent(index) => Some(index),
                _ => None,
            },
            values: values.into(),
        };
        Ok(LocatedKey {
            swept: swept.into(),
            path,
            spans: nodes.iter().map(|node| node.span).collect(),
        })
    } else {
        Err(wrong)
    }
}

/// Why the value at a path cannot be swept, with what to write instead; `None` where it can.
fn not_swept(path: &KeyPath<'_>) -> Option<(&'static str, &'static str)> {
    match path.target {
        Target::Seeds => Some((
            "seeds cannot be swept: a seed is a replicate, not a setting",
            "write `seeds: N` or a list of seeds at the top level",
        )),
        Target::Play(_) => Some(("a play cannot be swept", "write a second play under `cross_play`")),
        Target::Search(_) => Some((
            "a search cannot be swept",
            "write a second search, of an agent of its own",
        )),
        Target::Prepared(..) => Some((
            "what an entry of `prepare` is made of cannot be swept",
            "give each value an entry of its own, and sweep or override which one is taken",
        )),
        _ if path.is_preset() => Some((
            "a preset cannot be swept",
            "give each preset a name of its own under `environments` or `agents`",
        )),
        _ => None,
    }
}

/// The values of a key with their positions.
fn values<'a>(
    (generator, written): (Option<&Generator>, &'a Entry),
    path: &KeyPath<'_>,
    at: &str,
    sources: &Sources,
) -> Result<(Vec<Value>, Cow<'a, [Node]>), Box<Diagnostic>> {
    let (low, high, count, log) = match generator {
        // The check against the schema refuses such a generator.
        None => return Ok(Default::default()),
        Some(Generator::Grid(ValueList(values)) | Generator::Zip(ValueList(values))) => {
            return Ok((values.clone(), written.value.items().into()));
        }
        Some(&Generator::Random(Samples { low, high, samples })) => (low, high, samples, false),
        Some(&Generator::LogUniform(Samples { low, high, samples })) => (low, high, samples, true),
        Some(&Generator::LatinHypercube(SlicedSamples {
            low,
            high,
            samples,
            log,
        })) => (low, high, samples, log),
    };
    if count > MOST_SAMPLES {
        return Ok(Default::default());
    }
    let range = numbers(written, path, (low, high, log), at, sources)?;
    let name = path.name();
    let drawn = if written.key == "latin_hypercube" {
        slices(&name, count)
    } else {
        independent(&name, &written.key, count)
    };
    let values: Vec<Value> = drawn.into_iter().map(|share| range.at(share)).collect();
    let node = |value: &Value| Node::from_value(written.key_span, value);
    let nodes = values.iter().map(node).collect();
    Ok((values, nodes))
}

/// Numbers between the two limits under the key of `written`, for a key of the study.
///
/// # Errors
/// Limits that enclose no valid number.
pub(super) fn numbers(
    written: &Entry,
    path: &KeyPath<'_>,
    (low, high, log): (f64, f64, bool),
    at: &str,
    sources: &Sources,
) -> Result<Numbers, Box<Diagnostic>> {
    let span = |key: &str| written.value.get(key).map_or(written.key_span, |node| node.span);
    let fail = |key: &str, message: String| {
        Err(Box::new(sources.error(
            span(key),
            &format!("{at}.{}.{key}", written.key),
            message,
        )))
    };
    if low >= high {
        return fail(
            "high",
            format!("`high` is {high}, but must be above `low`, which is {low}"),
        );
    }
    if path.schema.is_integer() && low.ceil() > high.floor() {
        return fail("low", format!("no integer lies between {low} and {high}"));
    }
    if log && low <= 0.0 {
        return fail(
            "low",
            format!("`low` is {low}, but the logarithm is spread only over numbers above 0"),
        );
    }
    Ok(Numbers {
        low,
        high,
        log,
        integer: path.schema.is_integer(),
    })
}

impl KeyPath<'_> {
    /// The keys joined into one word, which names the random stream of a sampled key.
    fn name(&self) -> String {
        let target = match self.target {
            Target::Environment(_) => "environment",
            Target::Agent(_) => "agent",
            Target::Protocol | Target::Play(_) | Target::Search(_) | Target::Prepared(..) | Target::Seeds => {
                "protocol"
            }
        };
        format!("{target}.{}", self.keys.join("."))
    }
}

/// Shares between 0 and 1, one per sample.
fn independent(name: &str, generator: &str, count: usize) -> Vec<f64> {
    let mut rng = random::stream(&["sweep", generator, name]);
    (0..count).map(|_| rng.random::<f64>()).collect()
}

/// Shares between 0 and 1, one in each of `count` equal slices, in random order (McKay et al. 1979).
fn slices(name: &str, count: usize) -> Vec<f64> {
    let mut rng = random::stream(&["sweep", "latin_hypercube", name]);
    let mut order: Vec<usize> = (0..count).collect();
    order.shuffle(&mut rng);
    #[allow(clippy::cast_precision_loss, reason = "a number of samples is far below 2^52")]
    order
        .into_iter()
        .map(|slice| (slice as f64 + rng.random::<f64>()) / count as f64)
        .collect()
}

fn unequal(
    first: &LocatedKey<'_>,
    key: &LocatedKey<'_>,
    group: &str,
    sources: &Sources,
) -> Option<Diagnostic> {
    let (mine, theirs) = (key.swept.values.len(), first.swept.values.len());
    if mine == theirs {
        return None;
    }
    let what = if group == "zip" { "values" } else { "samples" };
    let message = format!(
        "`{}` has {mine} {what}, but `{}` has {theirs}",
        key.swept.key, first.swept.key
    );
    let error = sources.error(key.path.span, &format!("sweep.{}", key.swept.key), message);
    let rule = if group == "zip" {
        "`zip` keys go together, one by one"
    } else {
        "sampled keys share their sample index"
    };
    Some(
        error
            .help(format!("{rule}: give all the same number of {what}"))
            .note("the other key is here", sources.place(first.path.span)),
    )
}

fn swept_twice(dimensions: &[Dimension<'_>], sources: &Sources) -> Vec<Diagnostic> {
    let keys: Vec<&LocatedKey<'_>> = dimensions.iter().flat_map(|dimension| &dimension.keys).collect();
    let mut found = Vec::new();
    for (index, key) in keys.iter().enumerate() {
        if let Some(other) = keys[..index].iter().find(|other| other.path.overlaps(&key.path)) {
            let message = format!("`{}` is swept twice", key.swept.key);
            let error = sources.error(key.path.span, &format!("sweep.{}", key.swept.key), message);
            found.push(error.note("it is swept first here", sources.place(other.path.span)));
        }
    }
    found
}

/// Reports points of a `grid` or `zip` that are written twice. Samples may repeat because they are rounded.
fn points_twice(dimensions: &[Dimension<'_>], sources: &Sources) -> Vec<Diagnostic> {
    let mut found = Vec::new();
    for Dimension { keys, .. } in dimensions {
        let Some(first) = keys.first() else { continue };
        let mut seen = BTreeMap::new();
        for (index, span) in first.spans.iter().enumerate() {
            let point = point(keys, index);
            let earlier = *seen.entry(point).or_insert(*span);
            if earlier != *span {
                let message = "this point of the sweep is given twice";
                let error = sources.error(*span, &format!("sweep.{}", first.swept.key), message);
                let note = error.note("it is given first here", sources.place(earlier));
                found.push(note.help("write it once: its trials would be the same ones"));
            }
        }
    }
    found
}

/// The values of all keys at one point, as texts that are equal if the values are equal.
fn point(keys: &[LocatedKey<'_>], index: usize) -> Vec<String> {
    let values = keys.iter().filter_map(|key| key.swept.values.get(index));
    values
        .map(|value| comparable(value.clone()).to_string())
        .collect()
}

/// A value in which 1 and 1.0 are equal, as they are in trials.
pub(super) fn comparable(value: Value) -> Value {
    match value {
        Value::Number(number) => match number.as_i64() {
            // Not every larger integer is a floating-point number.
            Some(whole) if whole.unsigned_abs() < 1 << f64::MANTISSA_DIGITS => number.as_f64().into(),
            _ => number.into(),
        },
        Value::Array(items) => items.into_iter().map(comparable).collect(),
        Value::Object(map) => map
            .into_iter()
            .map(|(key, value)| (key, comparable(value)))
            .collect(),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_samples_keep_the_earlier_ones() {
        assert_eq!(
            independent("agent.lr", "random", 8)[..],
            independent("agent.lr", "random", 20)[..8]
        );
        assert_ne!(
            independent("agent.lr", "random", 8),
            independent("agent.tau", "random", 8)
        );
    }

    #[test]
    fn a_latin_hypercube_has_one_sample_in_each_slice() {
        let mut slices: Vec<usize> = slices("agent.lr", 50)
            .into_iter()
            .map(|share| (share * 50.0) as usize)
            .collect();
        assert_ne!(slices, (0..50).collect::<Vec<_>>(), "the order is random");
        slices.sort_unstable();
        assert_eq!(slices, (0..50).collect::<Vec<_>>());
    }
}
