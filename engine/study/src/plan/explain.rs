//! Reasons of new trials: one line per cell and reason for people, one object per cell and reason for programs.

use super::{Novelty, Reason};
use document::count::either;
use serde_json::{Value, json};
use std::{
    collections::BTreeSet,
    fmt::{self, Display, Formatter},
};

/// Number of differences that one line shows; further ones are only counted.
const MOST_DIFFERENCES: usize = 4;

impl Display for Reason {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Reason::NewSeed { stored } => new_seed(out, stored),
            Reason::Changed {
                differences,
                new_seed: seeds,
            } => {
                let shown: Vec<String> = differences
                    .iter()
                    .take(MOST_DIFFERENCES)
                    .map(ToString::to_string)
                    .collect();
                write!(out, "{}", shown.join(", "))?;
                if differences.len() > MOST_DIFFERENCES {
                    write!(out, " and {} more", differences.len() - MOST_DIFFERENCES)?;
                }
                let Some(stored) = seeds else { return Ok(()) };
                write!(out, ", ")?;
                new_seed(out, stored)
            }
            Reason::Takes(sources) => {
                let names: Vec<&str> = sources.iter().map(String::as_str).collect();
                write!(
                    out,
                    "takes from {}, which {} new",
                    names.join(" and "),
                    either(&names.len(), "is", "are")
                )
            }
            Reason::NothingLikeIt => write!(out, "nothing like it is stored"),
            Reason::Killed => write!(out, "was killed from outside"),
            Reason::Failed(state) => write!(out, "{}; use --retry-failed", state.name()),
        }
    }
}

fn new_seed(out: &mut Formatter<'_>, stored: &BTreeSet<u64>) -> fmt::Result {
    write!(
        out,
        "new seed (stored: {})",
        document::count::seed_ranges(&stored.iter().copied().collect::<Vec<_>>())
    )
}

/// One line per cell and reason in aligned columns; a single line if one reason holds for every cell.
#[must_use]
pub fn explain(novelties: &[Novelty]) -> String {
    let Some(first) = novelties.first() else {
        return String::new();
    };
    let same = |other: &Novelty| other.seeds == first.seeds && other.reason == first.reason;
    let rows: Vec<[String; 5]> = if novelties.len() > 3 && novelties.iter().all(same) {
        let cells = format!("each of {} cells", novelties.len());
        vec![[
            cells,
            String::new(),
            String::new(),
            seeds(first),
            first.reason.to_string(),
        ]]
    } else {
        let row = |it: &Novelty| {
            [
                it.environment.clone(),
                it.agent.clone(),
                it.setting.clone(),
                seeds(it),
                it.reason.to_string(),
            ]
        };
        novelties.iter().map(row).collect()
    };
    let width = |column: usize| {
        rows.iter()
            .map(|row| row[column].chars().count())
            .max()
            .unwrap_or(0)
    };
    let widths: [usize; 4] = std::array::from_fn(width);
    let line = |row: &[String; 5]| {
        let columns = row.iter().zip(widths).filter(|(_, width)| *width > 0);
        let columns: Vec<String> = columns.map(|(word, width)| format!("{word:<width$}")).collect();
        format!("    {}  {}", columns.join("  "), row[4])
    };
    format!("  why:\n{}", rows.iter().map(line).collect::<Vec<_>>().join("\n"))
}

fn seeds(it: &Novelty) -> String {
    format!(
        "{} {}",
        either(&it.seeds.len(), "seed", "seeds"),
        document::count::seed_ranges(&it.seeds)
    )
}

/// The same for programs: names, seeds, a word for the reason, the line's text, and every difference.
#[must_use]
pub fn to_json(novelties: &[Novelty]) -> Value {
    novelties.iter().map(novelty_as_json).collect()
}

fn novelty_as_json(it: &Novelty) -> Value {
    let (word, differences, stored) = match &it.reason {
        Reason::NewSeed { stored } => ("new_seed", Vec::new(), Some(stored)),
        Reason::Changed {
            differences,
            new_seed,
        } => ("changed", differences.clone(), new_seed.as_ref()),
        Reason::Takes(_) => ("source_is_new", Vec::new(), None),
        Reason::NothingLikeIt => ("nothing_like_it", Vec::new(), None),
        Reason::Killed => ("killed", Vec::new(), None),
        Reason::Failed(state) => (state.name(), Vec::new(), None),
    };
    let differences: Vec<Value> = differences
        .into_iter()
        .map(|difference| {
            json!({"what": difference.what, "stored": difference.stored,
            "planned": difference.planned})
        })
        .collect();
    json!({
        "environment": it.environment, "agent": it.agent, "setting": it.setting, "seeds": it.seeds,
        "reason": word, "text": it.reason.to_string(), "differences": differences, "stored_seeds": stored,
    })
}
