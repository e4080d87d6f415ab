//! `confirm`: claims and published values of a study that are tested on fresh seeds.
//!
//! A claim that is open after all seeds of its study cannot be decided by further seeds that are added because of the
//! results. A confirmation names its claims and its seeds before its first trial. It is computed as a study of its own
//! with the same combinations, and the final verdict is that of all rounds together.

use super::seeds::{SeedPlan, SeedsText};
use document::{
    FittingItems, Node,
    diagnostic::{Diagnostic, Sources, Span},
};
use presentation::{claim_spec::ClaimSpec, table::TableSpec};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::spending::SequentialDesign;

/// A confirmation as it is written.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct ConfirmationText {
    /// Numbers of claims of this study, from 1.
    #[serde(default)]
    #[schemars(inner(range(min = 1)), extend("uniqueItems" = true))]
    claims: Vec<usize>,
    /// Tables of this study whose published values are put to these seeds.
    #[serde(default)]
    #[schemars(extend("uniqueItems" = true))]
    tables: Vec<String>,
    /// Rows of these tables, by their names there; all that have published values where absent.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schemars(extend("uniqueItems" = true))]
    rows: Vec<String>,
    /// Seeds above all those that were used for these claims and values: a list, ranges, or a design with `first`.
    seeds: SeedsText,
    /// The smallest difference that matters from now on, if the claims name none or a larger one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    min_effect: Option<f64>,
    /// Reason for these seeds and for this difference.
    #[serde(default)]
    why: String,
}

/// A round of seeds for some claims and published values.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Confirmation {
    /// Indices of the confirmed claims.
    #[serde(skip)]
    pub claims: Vec<usize>,
    /// Names of the confirmed tables.
    #[serde(skip)]
    pub tables: Vec<String>,
    /// Names of the confirmed rows; empty if all are confirmed.
    #[serde(skip)]
    pub rows: Vec<String>,
    /// All seeds that it may use.
    #[serde(skip)]
    pub seeds: Vec<u64>,
    /// The looks at which seeds are added; `None` if their number is fixed.
    #[serde(skip)]
    pub design: Option<SequentialDesign>,
    /// The smallest difference that matters from now on; `None` if it does not change.
    #[serde(skip)]
    pub min_effect: Option<f64>,
    /// Reason for these seeds.
    #[serde(skip)]
    pub why: String,
    /// The section as it is written.
    #[serde(flatten)]
    written: serde_json::Map<String, serde_json::Value>,
}

impl Confirmation {
    /// A claim with the seeds and the smallest difference of this round.
    #[must_use]
    pub fn claim(&self, claim: &ClaimSpec) -> ClaimSpec {
        ClaimSpec {
            min_effect: self.min_effect.or(claim.min_effect),
            // The seeds of a round are fresh.
            exploratory: false,
            ..claim.clone()
        }
    }

    /// A table with the rows of this round and their published values.
    #[must_use]
    pub fn table(&self, spec: &TableSpec) -> TableSpec {
        let mut spec = spec.clone();
        if !self.rows.is_empty() {
            spec.published.retain(|row, _| self.rows.contains(row));
        }
        spec
    }
}

/// The rounds of the section, checked against the rest of the study. `used` are the seeds of the study and of its
/// searches.
///
/// # Errors
/// Unknown claims and tables, and seeds that are not above all those that were used.
pub(super) fn rounds(
    texts: &FittingItems<ConfirmationText>,
    root: &Node,
    (claims, tables): (&[ClaimSpec], &[(String, TableSpec)]),
    used: &[u64],
    sources: &Sources,
) -> Result<Vec<Confirmation>, Vec<Diagnostic>> {
    let (mut rounds, mut found): (Vec<Confirmation>, Vec<Diagnostic>) = (Vec::new(), Vec::new());
    for (index, text, node) in texts.located(root.get("confirm")) {
        let section = Section {
            text,
            node,
            at: format!("confirm[{index}]"),
            sources,
        };
        match section.round() {
            Ok(round) => {
                found.extend(section.unknown_claim(&round, claims));
                found.extend(section.unknown_table(&round, tables));
                found.extend(section.larger_difference(&round, claims));
                found.extend(section.seen_seed(&round, &rounds, used));
                rounds.push(round);
            }
            Err(errors) => found.extend(errors),
        }
    }
    if found.is_empty() { Ok(rounds) } else { Err(found) }
}

/// A confirmation with its position.
struct Section<'a> {
    text: &'a ConfirmationText,
    node: &'a Node,
    at: String,
    sources: &'a Sources,
}

impl Section<'_> {
    fn round(&self) -> Result<Confirmation, Vec<Diagnostic>> {
        let written = self.text;
        let SeedPlan { seeds, design } =
            SeedPlan::of(Some(&written.seeds), self.node.get("seeds"), self.sources)?;
        if written.claims.is_empty() && written.tables.is_empty() {
            let error = self
                .sources
                .error(self.node.span, &self.at, "this confirms nothing");
            return Err(vec![error.help(
                "name the claims by their numbers, as in `claims: [1, 3]`, or tables with published values",
            )]);
        }
        Ok(Confirmation {
            claims: written.claims.iter().map(|number| number - 1).collect(),
            tables: written.tables.clone(),
            rows: written.rows.clone(),
            seeds,
            design,
            min_effect: written.min_effect,
            why: written.why.clone(),
            written: self.node.to_value().as_object().cloned().unwrap_or_default(),
        })
    }

    fn error(&self, key: &str, message: String) -> Diagnostic {
        let span: Span = self
            .node
            .entry(key)
            .map_or(self.node.span, |entry| entry.key_span);
        self.sources.error(span, &format!("{}.{key}", self.at), message)
    }

    fn unknown_claim(&self, round: &Confirmation, claims: &[ClaimSpec]) -> Option<Diagnostic> {
        let unknown = round.claims.iter().find(|index| **index >= claims.len())?;
        let error = self.error("claims", format!("there is no claim {}", unknown + 1));
        Some(match claims.len() {
            0 => error.help("this study has no claims"),
            n => error.help(format!(
                "claims are counted from 1 in their order; the last is {n}"
            )),
        })
    }

    fn unknown_table(&self, round: &Confirmation, tables: &[(String, TableSpec)]) -> Option<Diagnostic> {
        let has_values = |name: &&String| {
            let table = tables.iter().find(|(known, _)| known == *name);
            table.is_some_and(|(_, table)| !round.table(table).published.is_empty())
        };
        let unknown = round.tables.iter().find(|name| !has_values(name))?;
        let of_rows = if round.rows.is_empty() {
            ""
        } else {
            " in these rows"
        };
        let message = format!("there is no table `{unknown}` with published values{of_rows}");
        Some(
            self.error("tables", message)
                .help("name tables of this study that have `published`"),
        )
    }

    /// Refuses a smallest difference that is larger than the one chosen before results were seen.
    fn larger_difference(&self, round: &Confirmation, claims: &[ClaimSpec]) -> Option<Diagnostic> {
        let min_effect = round.min_effect?;
        let named = round.claims.iter().filter_map(|index| claims.get(*index));
        let smaller = named
            .filter_map(|claim| claim.min_effect)
            .find(|known| *known < min_effect)?;
        let message = format!(
            "a difference of {smaller} mattered before its results were seen, and here only {min_effect} does"
        );
        Some(
            self.error("min_effect", message)
                .help("leave it out, or write a smaller one"),
        )
    }

    /// The error of a seed that is not above all those that were used for the same claims or values.
    fn seen_seed(&self, round: &Confirmation, earlier: &[Confirmation], used: &[u64]) -> Option<Diagnostic> {
        let shares = |other: &&Confirmation| {
            other.claims.iter().any(|claim| round.claims.contains(claim))
                || other.tables.iter().any(|table| round.tables.contains(table))
        };
        let of_rounds = earlier.iter().filter(shares).flat_map(|other| &other.seeds);
        let last = of_rounds.chain(used).max().copied()?;
        let seed = round.seeds.iter().find(|seed| **seed <= last)?;
        let next = last.saturating_add(1);
        let message =
            format!("seed {seed} is not above seed {last}, which has been seen: what it says may be known");
        let help = format!(
            "use larger seeds, as in `seeds: {next}-{}` or `first: {next}` of a design",
            next.saturating_add(9)
        );
        Some(self.error("seeds", message).help(help))
    }
}
