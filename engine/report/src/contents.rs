//! Computed contents of a report: grids, charts, claims, and the number of each outcome.

use super::{
    collapses, files, floors,
    kept::{FigureFacts, KeptFigure},
    manifest::Manifest,
    rounds::{ConfirmedVerdict, RoundVerdict},
    study_info::StudyInfo,
};
use analysis::{
    claim::{self, Aggregate, Claim, ClaimOutcome, ClaimVerdict, Operand, evaluate},
    cross_play::Encounters,
    results::{Cost, Programs, Results, repeats_in_words},
    training_share::{self, trained},
};
use contract::{
    standard_metrics::{TIMES_ARE_OF_THE_MACHINE, names_times},
    trial::Combination,
    trial_result::TrialResult,
};
use imported::marked;
use presentation::{
    claim_spec::ClaimSpec,
    figure::{self, Chart, FigureSpec},
    table::{
        self, Axis, Grid, Heading, NumberFormat, Scope, TableSpec, changed_rule_in_words,
        unplanned_look_in_words, untrained_in_words,
    },
};
use serde::Serialize;
use statistics::{
    Seeds, Statement, TrainingShare, Verdict, holm,
    verdict::{self, NOT_AT_THIS_BUDGET},
};
use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

/// The word for a claim that cannot be read.
pub const UNREAD: &str = "NOT READ";

/// The most imported entries with a sentence each; more share one.
const MOST_ORIGINS: usize = 5;

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

/// A claim in one environment.
#[derive(Debug, Clone, PartialEq)]
pub struct ClaimLine {
    /// Number of the claim in the study, from 1.
    pub number: usize,
    /// The claim as the study has it.
    pub spec: ClaimSpec,
    /// The environment, and the setting where there are several.
    pub place: String,
    /// The verdict of the seeds; the reason where the claim cannot be read.
    pub verdict: Result<ClaimVerdict, String>,
    /// The smallest difference that matters to the claim, in the unit of its metric; `None` where any difference
    /// matters.
    pub min_effect: Option<f64>,
    /// Share of the source's training behind the claim; `None` where the study does not state it.
    pub training: Option<TrainingShare>,
    /// An earlier number of seeds at which the verdict was seen without a plan.
    pub seen_at: Option<u32>,
    /// First rule of the verdict, if it was changed after the verdict was seen; the verdict is exploratory in that
    /// case.
    pub first_judged_by: Option<String>,
    /// Seeds that the verdict may rest on.
    pub looks: Seeds,
    /// The combinations whose seeds are behind it.
    pub rests_on: BTreeSet<Combination>,
    /// The verdict of each round alone, where there are several; `verdict` is that of all rounds together.
    pub rounds: Vec<RoundVerdict>,
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

/// Notes with sentences on the agents in the table or figure: on imported runs, and on programs that were computed
/// twice.
fn with_agents(
    mut notes: Vec<String>,
    results: &Results,
    programs: Programs,
    printed: impl Fn(&str) -> Option<String>,
) -> Vec<String> {
    let origins: Vec<_> = results
        .imported
        .iter()
        .filter(|origin| printed(&origin.name).is_some())
        .collect();
    match origins.len() {
        n if n > MOST_ORIGINS => notes.push(format!(
            "{n} of these are imported and were not run here; under Provenance stands what each is."
        )),
        _ => notes.extend(origins.into_iter().map(|origin| origin.sentence.clone())),
    }
    notes.extend(repeats_in_words(&results.repeated, programs, printed));
    notes
}

/// Notes with the sentence on times, where a table or figure shows times.
fn with_times(spec: &impl Serialize, mut notes: Vec<String>) -> Vec<String> {
    notes.extend(names_times(spec).then(|| TIMES_ARE_OF_THE_MACHINE.to_owned()));
    notes
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

impl ClaimLine {
    /// Approximate number of fresh seeds that would decide an open claim without looks left.
    pub(super) fn seeds_to_decide(&self) -> Option<u32> {
        let claim = self.verdict.as_ref().ok()?;
        let open = claim.verdict.is_open();
        let more = claim.more_seeds.filter(|_| open)?;
        u32::try_from(claim.n).ok().map(|n| n + more)
    }

    /// Word of the verdict, [`UNREAD`] where the claim cannot be read.
    #[must_use]
    pub fn word(&self) -> &'static str {
        self.verdict
            .as_ref()
            .map_or(UNREAD, |verdict| verdict.verdict.word())
    }

    /// The verdict with all claims of the study taken together (Holm), where it differs from that of the claim alone.
    #[must_use]
    pub fn together(&self) -> Option<ClaimOutcome> {
        self.verdict
            .as_ref()
            .ok()
            .and_then(|claim| claim.adjusted.filter(|adjusted| *adjusted != claim.verdict))
    }

    /// The verdict, followed by the verdict with all claims together (Holm) where that differs.
    #[must_use]
    pub fn verdict_in_words(&self) -> String {
        let at = match self.training {
            Some(share) if self.word() == NOT_AT_THIS_BUDGET => format!(" ({})", share.percent()),
            _ => String::new(),
        };
        let together = self.together();
        let holm = together.map_or_else(String::new, |outcome| format!(" (Holm: {outcome})"));
        format!("{}{at}{holm}", self.word())
    }

    /// The difference between the sides with its interval, its level and the number of seeds; empty before trials
    /// have run.
    #[must_use]
    pub fn numbers(&self) -> String {
        let (Ok(verdict), Some(difference)) = (&self.verdict, self.difference()) else {
            return String::new();
        };
        let level = verdict.interval.map_or(String::new(), |interval| {
            let percent = (1000.0 * interval.level).round() / 10.0;
            format!(" at {percent} %")
        });
        format!("{difference}{level}, {}", verdict.size())
    }

    /// The difference between the sides with its interval; `None` before trials have run.
    pub(super) fn difference(&self) -> Option<String> {
        let verdict = self.verdict.as_ref().ok()?;
        let difference = verdict.difference?;
        let ends = verdict.interval.map(|interval| [interval.low, interval.high]);
        let format = NumberFormat::fitting(ends.into_iter().flatten().chain([difference]));
        let interval = ends.map_or(String::new(), |[low, high]| {
            format!(" [{}, {}]", format.write(low), format.write(high))
        });
        Some(format!("{}{interval}", format.write(difference)))
    }

    /// The cause of a refuted claim; `None` where the claim is not refuted or the study states no cause.
    #[must_use]
    pub fn cause(&self) -> Option<&str> {
        let refuted = matches!(&self.verdict, Ok(claim) if claim.verdict == ClaimOutcome::Refuted);
        let text = self.spec.cause.as_deref().filter(|_| refuted)?.trim();
        Some(text).filter(|text| !text.is_empty())
    }

    /// Whether the claim, or the rule of its verdict, was chosen after results were seen.
    #[must_use]
    pub fn is_exploratory(&self) -> bool {
        self.spec.exploratory || self.first_judged_by.is_some()
    }

    /// Cautions and remarks on the verdict.
    #[must_use]
    pub fn notes(&self) -> Vec<String> {
        let exploratory = self
            .spec
            .exploratory
            .then(|| "exploratory: thought of after results were seen".to_owned());
        let calibrated =
            self.spec
                .calibrated_on
                .as_ref()
                .map(|on| match self.word() == ClaimOutcome::Refuted.word() {
                    true => format!("in spite of calibration: {on}"),
                    false => format!("calibrated: {on}"),
                });
        let min_effect = self
            .min_effect
            .map(|min_effect| match self.spec.min_effect {
                Some(_) => min_effect.to_string(),
                None => NumberFormat::fitting([min_effect].into_iter()).write(min_effect),
            })
            .map(|min_effect| format!("differences of less than {min_effect} do not matter"));
        let training = self.training.filter(|share| share.own < share.paper);
        let training = training.map(|share| share.to_string());
        let why = (!self.spec.why.is_empty()).then(|| self.spec.why.clone());
        let unplanned = self.seen_at.map(unplanned_look_in_words);
        let changed = self.first_judged_by.as_deref().map(changed_rule_in_words);
        let found = match &self.verdict {
            Err(reason) => vec![reason.clone()],
            Ok(claim) => notes_of(claim),
        };
        found
            .into_iter()
            .chain(
                [
                    unplanned,
                    changed,
                    exploratory,
                    calibrated,
                    training,
                    min_effect,
                    why,
                ]
                .into_iter()
                .flatten(),
            )
            .collect()
    }
}

fn notes_of(claim: &ClaimVerdict) -> Vec<String> {
    let open = claim.verdict.is_open();
    let stage = claim
        .stage
        .filter(|_| claim.verdict.is_judged())
        .map(|stage| stage.phrase(open));
    let more = claim
        .more_seeds
        .filter(|_| open && claim.stage.is_none())
        .map(verdict::more_seeds_in_words);
    claim.notes.iter().cloned().chain(stage).chain(more).collect()
}

/// The lines of a claim, one for each environment and setting.
pub(super) fn claim_lines(
    number: usize,
    spec: &ClaimSpec,
    study: &StudyInfo,
    results: &Results,
) -> Vec<ClaimLine> {
    let claim = match claim::parse(&spec.claim) {
        Ok(claim) => claim,
        Err(error) => return vec![claim_line(number, spec, String::new(), Err(error.to_string()))],
    };
    let held = |scope: &Scope<'_>, setting: Option<&str>, place: String| {
        let held = held_in(&claim, (spec, study), results, scope, setting);
        held.line(number, spec, place, results)
    };
    // If there are several settings, their names follow the place.
    let in_settings = |scope: &Scope<'_>, place: &str| {
        let line = |setting: Option<String>| {
            let named = |setting: &String| format!("{place}, {setting}");
            let place = setting.as_ref().map_or(place.to_owned(), named);
            held(scope, setting.as_deref(), place)
        };
        settings(&claim, scope).into_iter().map(line).collect::<Vec<_>>()
    };
    let all = Scope {
        trials: results.trials.iter().collect(),
    };
    if let Some(plays) = plays_of(&claim) {
        return vec![held(&all, None, plays)];
    }
    if let Some([left, right]) = claim.environments_of_sides() {
        return in_settings(&all, &format!("{left}, {right}"));
    }
    let environments = match claim.environment.as_ref().or(spec.environment.as_ref()) {
        Some(environment) => vec![environment.clone()],
        None => study.environments.clone(),
    };
    let in_environment =
        |environment: &String| in_settings(&all.at(Axis::Environment, environment), environment);
    environments.iter().flat_map(in_environment).collect()
}

/// A line without trials behind it yet.
fn claim_line(
    number: usize,
    spec: &ClaimSpec,
    place: String,
    verdict: Result<ClaimVerdict, String>,
) -> ClaimLine {
    ClaimLine {
        number,
        spec: spec.clone(),
        place,
        verdict,
        seen_at: None,
        first_judged_by: None,
        min_effect: spec.min_effect,
        training: None,
        looks: Seeds::default(),
        rests_on: BTreeSet::new(),
        rounds: Vec::new(),
    }
}

/// The plays that a claim is about; `None` if it is also about trials.
fn plays_of(claim: &Claim) -> Option<String> {
    let plays = claim
        .operands()
        .into_iter()
        .map(|it| Some(it.within.as_ref()?.play.as_str()));
    let plays: BTreeSet<&str> = plays.collect::<Option<_>>()?;
    Some(plays.into_iter().collect::<Vec<_>>().join(", "))
}

/// The verdict on a claim, with the trials behind it.
struct JudgedClaim<'r> {
    verdict: ClaimVerdict,
    /// The smallest difference that matters, in the unit of the metric; `None` where any difference matters.
    min_effect: Option<f64>,
    /// The trials behind the verdict.
    trials: Vec<&'r TrialResult>,
    looks: Seeds,
}

impl JudgedClaim<'_> {
    fn line(self, number: usize, spec: &ClaimSpec, place: String, results: &Results) -> ClaimLine {
        let training = training_share::behind(&self.trials, results);
        let verdict = ClaimVerdict {
            verdict: self.verdict.verdict.at_budget(training),
            ..self.verdict
        };
        ClaimLine {
            looks: self.looks,
            min_effect: self.min_effect,
            training,
            rests_on: self
                .trials
                .iter()
                .map(|trial| trial.combination().clone())
                .collect(),
            ..claim_line(number, spec, place, Ok(verdict))
        }
    }
}

/// The verdict on a claim in a scope, in one setting of agents with several, and the trials behind it.
fn held_in<'r>(
    claim: &Claim,
    (spec, study): (&ClaimSpec, &StudyInfo),
    results: &'r Results,
    scope: &Scope<'r>,
    setting: Option<&str>,
) -> JudgedClaim<'r> {
    let operands = claim.operands().into_iter();
    let trials: Vec<&TrialResult> = operands
        .flat_map(|operand| trials_behind(scope, results, operand, setting))
        .collect();
    let looks = results.seeds_of(&trials);
    let found = |operand: &Operand, limit: u64| match operand.within {
        Some(_) => in_play(results, operand, limit),
        None => values(scope, operand, setting),
    };
    let imported = |operand: &Operand| results.imported.iter().any(|origin| origin.name == operand.agent);
    let min_effect = spec.min_effect.or_else(|| margin(claim, study, &found));
    let mut verdict = hold(claim, (spec, min_effect), &trials, &looks, &found, &imported);
    let trained = trained(&trials, results);
    if verdict.verdict.is_judged() && !floors::are_passed(claim, study, &trained, &found) {
        verdict = ClaimVerdict {
            verdict: ClaimOutcome::NotLearned,
            statement: None,
            notes: vec![floors::in_words(&study.floors)],
            ..verdict
        };
    }
    let notes = std::mem::take(&mut verdict.notes);
    let named = |name: &str| {
        let is_there = trials.iter().any(|it| it.trial.cell.agent == name);
        is_there.then(|| name.to_owned())
    };
    verdict.notes = with_agents(notes, results, Programs::OnlyLacking, named);
    JudgedClaim {
        verdict,
        min_effect,
        trials,
        looks,
    }
}

/// The difference that matters by the rule of the study, in the metric and the place of a claim's first operand.
fn margin(
    claim: &Claim,
    study: &StudyInfo,
    values: &dyn Fn(&Operand, u64) -> Option<Vec<(u64, f64)>>,
) -> Option<f64> {
    let relevance = study
        .relevance
        .as_ref()
        .filter(|_| claim.relation.is_direction())?;
    let first = *claim.operands().first()?;
    let of_agent = |agent: &str| {
        let operand = Operand {
            agent: agent.into(),
            setting: Vec::new(),
            ..first.clone()
        };
        let values = values(&operand, u64::MAX)?;
        Some(values.into_iter().map(|(_, value)| value).collect())
    };
    relevance.margin(&of_agent)
}

/// The verdict on a claim. It is NOT TRAINED if an agent behind it made no update, and CALIBRATED if it agrees with a
/// choice that was made with the claim in view.
fn hold(
    claim: &Claim,
    (spec, min_effect): (&ClaimSpec, Option<f64>),
    trials: &[&TrialResult],
    looks: &Seeds,
    values: &dyn Fn(&Operand, u64) -> Option<Vec<(u64, f64)>>,
    imported: &dyn Fn(&Operand) -> bool,
) -> ClaimVerdict {
    let verdict = evaluate(claim, min_effect, values, imported, looks);
    let untrained: BTreeSet<&str> = trials
        .iter()
        .filter(|trial| trial.updates() == Some(0.0))
        .map(|trial| trial.trial.cell.agent.as_str())
        .collect();
    if !untrained.is_empty() {
        let notes = vec![untrained_in_words(untrained.into_iter())];
        return ClaimVerdict {
            verdict: ClaimOutcome::NotTrained,
            permutation: None,
            statement: None,
            notes,
            ..verdict
        };
    }
    let agrees = [ClaimOutcome::Supported, ClaimOutcome::DirectionOnly].contains(&verdict.verdict);
    if spec.calibrated_on.is_some() && agrees {
        return ClaimVerdict {
            verdict: ClaimOutcome::Calibrated,
            statement: None,
            ..verdict
        };
    }
    verdict
}

/// The trials of an operand, including those that have not run.
fn trials_behind<'r>(
    scope: &Scope<'r>,
    results: &'r Results,
    operand: &Operand,
    setting: Option<&str>,
) -> Vec<&'r TrialResult> {
    match &operand.within {
        Some(within) => Encounters::of(results, &within.play).trials(&[(&within.role, &operand.agent)]),
        None => of_setting(scope, operand, setting).trials,
    }
}

/// The trials of an operand's agent, in one setting where it has several.
fn of_setting<'r>(scope: &Scope<'r>, operand: &Operand, setting: Option<&str>) -> Scope<'r> {
    let scope = told_apart(scope, operand);
    match setting.filter(|_| scope.varies(Axis::Setting)) {
        Some(setting) => scope.at(Axis::Setting, setting),
        None => scope,
    }
}

/// The trials of an operand's agent that have the values of swept keys that the claim names.
fn told_apart<'r>(scope: &Scope<'r>, operand: &Operand) -> Scope<'r> {
    let mut scope = scope.at(Axis::Agent, &operand.agent);
    if let Some(environment) = &operand.environment {
        scope = scope.at(Axis::Environment, environment);
    }
    scope
        .trials
        .retain(|trial| operand.is_at(&trial.trial.cell.point));
    scope
}

/// The settings in which a claim is evaluated one by one: those of its agents with several. Settings are never
/// pooled.
fn settings(claim: &Claim, scope: &Scope<'_>) -> Vec<Option<String>> {
    let mut settings: Vec<Option<String>> = Vec::new();
    for operand in claim.operands() {
        let own = told_apart(scope, operand).names(Axis::Setting, &[]);
        let new = own
            .iter()
            .filter(|_| own.len() > 1)
            .cloned()
            .map(Some)
            .filter(|setting| !settings.contains(setting));
        settings.extend(new.collect::<Vec<_>>());
    }
    if settings.is_empty() { vec![None] } else { settings }
}

/// Values by seed below a limit of an agent in a role of a play: the mean over its trained opponents, with seeds
/// below the limit, too. `None` for operands outside plays.
fn in_play(results: &Results, operand: &Operand, limit: u64) -> Option<Vec<(u64, f64)>> {
    let within = operand
        .within
        .as_ref()
        .filter(|_| operand.aggregate == Aggregate::Final)?;
    let encounters = Encounters::of(results, &within.play).until(limit);
    let values = encounters.by_seed(&[(&within.role, &operand.agent)], &operand.metric);
    Some(values.into_iter().collect())
}

/// Values by seed of an operand, in one setting where its agent has several; `None` where there is none.
fn values(scope: &Scope<'_>, operand: &Operand, setting: Option<&str>) -> Option<Vec<(u64, f64)>> {
    let scope = of_setting(scope, operand, setting);
    let value = |trial: &&TrialResult| {
        Some((
            trial.trial.key.seed,
            operand.aggregate.of_trial(trial, &operand.metric)?,
        ))
    };
    let values: Vec<(u64, f64)> = scope
        .trials
        .iter()
        .filter(|trial| trial.is_ok())
        .filter_map(value)
        .collect();
    (!values.is_empty()).then_some(values)
}
