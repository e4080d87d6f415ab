//! Computed contents of a report: grids, charts, claims, and the number of each outcome.

use super::{
    claim_line::{ClaimLine, UNREAD, claim_lines},
    collapses, files,
    kept::{FigureFacts, KeptFigure},
    manifest::Manifest,
    notes::{with_agents, with_times},
    rounds::ConfirmedVerdict,
    study_info::StudyInfo,
};
use analysis::{
    claim::ClaimOutcome,
    results::{Cost, Programs, Results},
};
use contract::trial::Combination;
use imported::marked;
use presentation::{
    figure::{self, Chart, FigureSpec},
    table::{self, Grid, Heading, TableSpec},
};
use statistics::{Statement, Verdict, holm};
use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

/// Reason for a figure that cannot be made from a record.
const NOT_RECORDED: &str = "what it shows is in no record";

/// Everything that a report shows, in the order of the study. An entry that could not be made holds the reason
/// instead.
#[derive(Debug, Clone, Default)]
pub struct Contents {
    /// Tables by name; the reason where a table could not be made.
    pub tables: Vec<(String, Result<Grid, String>)>,
    /// Figures by name; the reason where a figure could not be made.
    pub figures: Vec<(String, Result<Chart, String>)>,
    /// Claims, one line for each environment and setting of their evaluation.
    pub claims: Vec<ClaimLine>,
    /// Sentences on figures whose drawing differs from the study.
    pub warnings: Vec<String>,
    /// Path of the damaged record of seen verdicts, inside the store; `None` where the record is intact. Earlier
    /// looks are unknown then.
    pub lost_record: Option<PathBuf>,
    /// Whether the study belongs to a family, whose verdicts are taken together elsewhere.
    pub(super) has_family: bool,
    /// Claims and values with several rounds of seeds.
    pub(super) confirmed: Vec<ConfirmedVerdict>,
    /// Number and time of the trials of each confirmation.
    pub(super) rounds: Vec<Cost>,
    /// Sentences on the dates when the rounds of confirmations were fixed.
    pub(super) fixed: Vec<String>,
    /// Drawings of an earlier report by figure; each replaces a figure that could not be made.
    pub kept: BTreeMap<String, KeptFigure>,
}

/// Number of items by word; words with no item are left out.
pub type Counts = Vec<(&'static str, usize)>;

/// A judged value or claim that the seeds leave open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Open<'a> {
    /// The combinations whose further seeds would decide it.
    pub rests_on: &'a BTreeSet<Combination>,
    /// Number of planned looks that are complete.
    pub complete: usize,
}

impl Contents {
    /// Computes all tables, figures and claims of a study.
    #[must_use]
    pub fn of(study: &StudyInfo, results: &Results) -> Self {
        let context = figure::Context {
            results,
            agents: &study.agents,
            units: &study.units,
            better: &study.better,
        };
        let mut warnings = Vec::new();
        let mut chart = |name: &str, spec: &FigureSpec| {
            if results.told.is_some() && !spec.kind.is_recorded() {
                return Err(NOT_RECORDED.to_owned());
            }
            let spec = marked_in(spec, results);
            let mut chart = figure::build(&spec, context).map_err(|error| error.to_string())?;
            let notes = with_times(&spec, std::mem::take(&mut chart.notes));
            chart.notes = with_agents(notes, results, Programs::OnlyLacking, |name| {
                let label = spec.labels.get(name).map_or(name, String::as_str);
                shows(&chart, label).then(|| label.to_owned())
            });
            if let Some(sentence) = figure::lacking(&chart) {
                warnings.push(format!("figure `{name}`: {sentence}"));
                chart.notes.push(sentence);
            }
            Ok(chart)
        };
        let figures = study
            .figures
            .iter()
            .map(|(name, spec)| (name.clone(), chart(name, spec)))
            .collect();
        Self {
            figures,
            warnings,
            ..Self::judged(study, results)
        }
    }

    /// Computes only tables and claims, which carry all verdicts.
    #[must_use]
    pub fn judged(study: &StudyInfo, results: &Results) -> Self {
        let grid = |spec: &TableSpec| make_table(spec, study, results).map_err(|error| error.to_string());
        let mut contents = Self {
            tables: study
                .tables
                .iter()
                .map(|(name, spec)| (name.clone(), grid(spec)))
                .collect(),
            claims: study
                .claims
                .iter()
                .enumerate()
                .flat_map(|(index, spec)| claim_lines(index + 1, spec, study, results))
                .collect(),
            has_family: study.family.is_some(),
            ..Self::default()
        };
        if study.is_rehearsal {
            contents.judge_nothing();
        }
        contents.adjust();
        contents
    }

    /// Keeps tables and figures of an earlier report if this one lacks their data, so that an empty table does not
    /// replace one with numbers. A note on the kept item takes its position.
    pub fn leave_to(&mut self, earlier: &Manifest) {
        let has = |files: &[String]| files.iter().any(|file| earlier.names(file));
        let are = "; its files are those of an earlier report";
        for (name, grid) in &mut self.tables {
            if !has(&files::paths_of_table(name)) {
                continue;
            }
            match grid {
                Ok(grid) if grid.cells.iter().flatten().any(|cell| cell.estimate.is_some()) => {}
                Ok(_) => *grid = Err(format!("none of its numbers is there{are}")),
                Err(reason) => reason.push_str(are),
            }
        }
        for (name, chart) in &mut self.figures {
            if let Err(reason) = chart
                && has(&files::paths_of_figure(name))
            {
                reason.push_str(are);
            }
        }
    }

    /// Keeps drawings of an earlier report for figures that could not be made, if the `facts` about them are known.
    ///
    /// # Errors
    /// [`Error::Record`](contract::Error::Record) where a drawing does not have the hash of its report.
    pub fn keep(
        &mut self,
        folder: &Path,
        earlier: &Manifest,
        facts: &BTreeMap<String, FigureFacts>,
    ) -> Result<(), contract::Error> {
        for (name, _) in self.figures.iter().filter(|(_, chart)| chart.is_err()) {
            let Some(facts) = facts.get(name) else { continue };
            let kept = KeptFigure::read(folder, earlier, name, facts)?;
            self.kept.extend(kept.map(|kept| (name.clone(), kept)));
        }
        Ok(())
    }

    /// Whether every table and figure is shown, including kept drawings of an earlier report.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        let has_chart =
            |(name, chart): &(String, Result<Chart, String>)| chart.is_ok() || self.kept.contains_key(name);
        self.tables.iter().all(|(_, grid)| grid.is_ok()) && self.figures.iter().all(has_chart)
    }

    /// The files, by their names inside the folder of the report, of tables and figures that could not be made.
    #[must_use]
    pub fn unmade(&self) -> BTreeSet<String> {
        let tables = self.tables.iter().filter(|(_, grid)| grid.is_err());
        let figures = self.figures.iter().filter(|(_, chart)| chart.is_err());
        let of_tables = tables.flat_map(|(name, _)| files::paths_of_table(name));
        of_tables
            .chain(figures.flat_map(|(name, _)| files::paths_of_figure(name)))
            .collect()
    }

    /// Sets the level of the decision on each value and claim. If the study is a family of its own, all of them are
    /// taken together (Holm). Exploratory values and claims are in no family.
    pub fn adjust(&mut self) {
        self.leave_families();
        let is_family = !self.has_family;
        let grids = self
            .tables
            .iter_mut()
            .filter_map(|(_, grid)| grid.as_mut().ok())
            .filter(|grid| !grid.exploratory);
        let cells = grids
            .flat_map(|grid| grid.cells.iter_mut().flatten())
            .filter(|cell| cell.first_judged_by.is_none());
        let values = cells.filter_map(|cell| cell.judgement.as_mut());
        let mut values: Vec<_> = values.filter(|it| it.statement.is_some()).collect();
        let lines = self.claims.iter_mut().filter(|line| !line.is_exploratory());
        let claims = lines.filter_map(|line| line.verdict.as_mut().ok());
        let mut claims: Vec<_> = claims
            .filter(|claim| claim.statement.is_some() && claim.verdict.is_judged())
            .collect();
        for value in &mut values {
            value.strictest = value.statement.as_ref().and_then(Statement::strictest);
        }
        for claim in &mut claims {
            claim.strictest = claim.statement.as_ref().and_then(Statement::strictest);
        }
        if !is_family {
            return;
        }
        let of_values = values.iter().map(|it| it.strictest);
        let strictest: Vec<Option<f64>> = of_values.chain(claims.iter().map(|it| it.strictest)).collect();
        let decided = holm(&strictest);
        for (value, is_decided) in values.iter_mut().zip(&decided) {
            let falls = value.strictest.is_some() && !is_decided;
            value.adjusted = Some(if falls {
                Verdict::Inconclusive
            } else {
                value.verdict
            });
        }
        for (claim, is_decided) in claims.iter_mut().zip(&decided[values.len()..]) {
            let falls = claim.strictest.is_some() && !is_decided;
            claim.adjusted = Some(if falls {
                ClaimOutcome::Inconclusive
            } else {
                claim.verdict
            });
        }
    }

    /// Withdraws all verdicts.
    fn judge_nothing(&mut self) {
        let grids = self.tables.iter_mut().filter_map(|(_, grid)| grid.as_mut().ok());
        let cells = grids.flat_map(|grid| grid.cells.iter_mut().flatten());
        for judgement in cells.filter_map(|cell| cell.judgement.as_mut()) {
            judgement.statement = None;
            if judgement.verdict.is_judged() || judgement.verdict == Verdict::Calibrated {
                judgement.verdict = Verdict::NotJudged;
            }
        }
        for claim in self
            .claims
            .iter_mut()
            .filter_map(|line| line.verdict.as_mut().ok())
        {
            claim.statement = None;
            if claim.verdict.is_judged() || claim.verdict == ClaimOutcome::Calibrated {
                claim.verdict = ClaimOutcome::NotJudged;
            }
        }
    }

    fn leave_families(&mut self) {
        let grids = self.tables.iter_mut().filter_map(|(_, grid)| grid.as_mut().ok());
        let cells = grids.flat_map(|grid| grid.cells.iter_mut().flatten());
        let judgements = cells.filter_map(|cell| cell.judgement.as_mut());
        judgements.for_each(|judgement| judgement.adjusted = None);
        let claims = self
            .claims
            .iter_mut()
            .filter_map(|line| line.verdict.as_mut().ok());
        claims.for_each(|claim| claim.adjusted = None);
    }

    /// Number of published values by verdict, for exploratory or for planned ones.
    #[must_use]
    pub fn verdicts(&self, exploratory: bool) -> Counts {
        count_verdicts(self.cells(exploratory).filter_map(table::Cell::verdict))
    }

    /// Number of published values by verdict, with all judged values taken together (Holm). A value without a
    /// judgement yet keeps its verdict.
    #[must_use]
    pub fn verdicts_together(&self) -> Counts {
        let judgements = self.cells(false).filter_map(|cell| cell.judgement.as_ref());
        count_verdicts(judgements.map(|judgement| judgement.adjusted.unwrap_or(judgement.verdict)))
    }

    /// Number of claims by outcome, for exploratory or for planned ones; a claim counts once per environment.
    #[must_use]
    pub fn outcomes(&self, exploratory: bool) -> Counts {
        count_outcomes(self.lines(exploratory).map(ClaimLine::word))
    }

    /// Number of claims by outcome, with all claims taken together (Holm). A claim without a judgement yet keeps its
    /// outcome.
    #[must_use]
    pub fn outcomes_together(&self) -> Counts {
        count_outcomes(
            self.lines(false)
                .map(|line| line.together().map_or(line.word(), ClaimOutcome::word)),
        )
    }

    /// Whether a published value differs or a claim is refuted.
    #[must_use]
    pub fn contradicts(&self) -> bool {
        let refuted =
            |line: &ClaimLine| matches!(&line.verdict, Ok(claim) if claim.verdict == ClaimOutcome::Refuted);
        self.cells(false)
            .any(|cell| cell.verdict() == Some(Verdict::Differs))
            || self.lines(false).any(refuted)
    }

    /// Judged values and claims that are still open, without exploratory ones.
    #[must_use]
    pub fn open(&self) -> Vec<Open<'_>> {
        let is_open = |verdict: Verdict, complete| {
            verdict == Verdict::Inconclusive || verdict == Verdict::NotRun && complete == 0
        };
        let cells = self.cells(false).filter(|cell| {
            cell.verdict()
                .is_some_and(|it| is_open(it, cell.looks.complete()))
        });
        let cells = cells.map(|cell| Open {
            rests_on: &cell.rests_on,
            complete: cell.looks.complete(),
        });
        let is_open = |line: &&ClaimLine| {
            matches!(&line.verdict,
            Ok(claim) if claim.verdict.is_open())
        };
        let lines = self.lines(false).filter(is_open);
        cells
            .chain(lines.map(|line| Open {
                rests_on: &line.rests_on,
                complete: line.looks.complete(),
            }))
            .collect()
    }

    /// The combinations behind all published values and claims.
    #[must_use]
    pub fn rests_on(&self) -> BTreeSet<Combination> {
        let grids = self.tables.iter().filter_map(|(_, grid)| grid.as_ref().ok());
        let cells = grids.flat_map(|grid| grid.cells.iter().flatten());
        let cells = cells.filter(|cell| cell.published().is_some());
        let of_cells = cells.flat_map(|cell| &cell.rests_on);
        let of_claims = self.claims.iter().flat_map(|line| &line.rests_on);
        of_cells.chain(of_claims).cloned().collect()
    }

    fn cells(&self, exploratory: bool) -> impl Iterator<Item = &table::Cell> {
        let grids = self.tables.iter().filter_map(|(_, grid)| grid.as_ref().ok());
        let cells = grids.flat_map(|grid| grid.cells.iter().flatten().map(move |cell| (grid, cell)));
        cells
            .filter(move |(grid, cell)| grid.is_exploratory(cell) == exploratory)
            .map(|(_, cell)| cell)
    }

    fn lines(&self, exploratory: bool) -> impl Iterator<Item = &ClaimLine> {
        self.claims
            .iter()
            .filter(move |line| line.is_exploratory() == exploratory)
    }
}

fn count_verdicts(verdicts: impl Iterator<Item = Verdict>) -> Counts {
    count(&Verdict::ALL.map(Verdict::word), verdicts.map(Verdict::word))
}

fn count_outcomes(words: impl Iterator<Item = &'static str>) -> Counts {
    count(
        &[&ClaimOutcome::ALL.map(ClaimOutcome::word)[..], &[UNREAD]].concat(),
        words,
    )
}

/// Number of occurrences of each word in a list, in the order of the list.
fn count(list: &[&'static str], words: impl Iterator<Item = &'static str>) -> Counts {
    let words: Vec<&str> = words.collect();
    let counted = list
        .iter()
        .map(|word| (*word, words.iter().filter(|it| *it == word).count()));
    counted.filter(|(_, n)| *n > 0).collect()
}

/// A figure in which the names of imported runs are marked.
fn marked_in(spec: &FigureSpec, results: &Results) -> FigureSpec {
    let mut spec = spec.clone();
    for name in results.imported.iter().map(|origin| &origin.name) {
        let label = spec.labels.entry(name.clone()).or_insert_with(|| name.clone());
        *label = marked(label);
    }
    spec
}

/// Whether something in a figure has this label.
fn shows(chart: &Chart, label: &str) -> bool {
    chart.panels.iter().any(|panel| {
        let series = panel.series.iter().map(|series| &series.label);
        let categories = panel.x.categories.iter().chain(&panel.y.categories);
        series
            .chain(categories)
            .chain([&panel.title])
            .any(|text| text.contains(label))
    })
}

/// The label of an agent in a table; its name where it has no row or column of its own.
fn label(headings: &[Heading], name: &str) -> String {
    let own = headings.iter().find(|heading| heading.name == name);
    own.map_or_else(|| name.to_owned(), |heading| heading.label.clone())
}

pub(super) fn make_table(
    spec: &TableSpec,
    study: &StudyInfo,
    results: &Results,
) -> Result<Grid, contract::Error> {
    let mut grid = table::build(spec, results)?;
    let behind: BTreeSet<&str> = grid
        .cells
        .iter()
        .flatten()
        .flat_map(|cell| &cell.rests_on)
        .map(|cell| cell.agent.as_str())
        .collect();
    let headings = [&grid.rows[..], &grid.columns].concat();
    grid.notes = with_agents(
        with_times(spec, std::mem::take(&mut grid.notes)),
        results,
        Programs::All,
        |name| behind.contains(name).then(|| label(&headings, name)),
    );
    if let Some(metric) = spec.kind.metric_of_unit() {
        let notes = collapses::notes(&grid, metric, study, results);
        grid.notes.extend(notes);
    }
    for heading in grid.rows.iter_mut().chain(&mut grid.columns) {
        if results.imported.iter().any(|origin| origin.name == heading.name) {
            heading.label = marked(&heading.label);
        }
    }
    if let Some(metric) = spec.kind.metric_of_unit() {
        grid.unit = study
            .units
            .get(metric)
            .filter(|unit| *unit != "1")
            .cloned()
            .unwrap_or_default();
    }
    Ok(grid)
}
