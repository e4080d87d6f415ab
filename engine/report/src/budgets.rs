//! The budget of every agent: steps, updates, measured episodes and time.

use super::{
    StudyInfo,
    sheet::{NONE, Sheet, SheetEntry, Tone},
};
use analysis::results::{Cost, Printed, Ran, Results, Told};
use contract::{Phase, standard_metrics::EPISODE_LENGTH, trial::Purpose, trial_result::TrialResult};
use document::count::duration;
use imported::marked;
use std::collections::BTreeMap;

const HEAD: [&str; 9] = [
    "environment",
    "agent",
    "trials",
    "steps",
    "updates",
    "episodes while learning",
    "episodes at the end",
    "time per trial",
    "time in all",
];

/// The trials of an agent in an environment.
struct Budget<'a> {
    environment: &'a str,
    agent: &'a str,
    trials: Vec<&'a TrialResult>,
}

/// The words behind a number of updates that is 0.
const NOT_TRAINED: &str = ": not trained";

/// Statements of a report on all trials together, computed from their results.
#[must_use]
pub fn told(study: &StudyInfo, results: &Results) -> Told {
    Told {
        budgets: sheet(study, results).map(Printed::from),
        cost: cost(results),
        ran: Ran::of(results),
        repeated: results.repeated.clone(),
    }
}

impl From<Sheet> for Printed {
    fn from(sheet: Sheet) -> Self {
        let texts = |row: Vec<SheetEntry>| row.into_iter().map(|entry| entry.text).collect();
        Self {
            head: sheet.head,
            words: sheet.words,
            rows: sheet.rows.into_iter().map(texts).collect(),
            notes: sheet.notes,
        }
    }
}

impl From<&Printed> for Sheet {
    fn from(printed: &Printed) -> Self {
        let entry = |text: &String| {
            let tone = if text.ends_with(NOT_TRAINED) {
                Tone::Alarm
            } else {
                Tone::Plain
            };
            SheetEntry::of(tone, text)
        };
        let row = |texts: &Vec<String>| texts.iter().map(entry).collect();
        Self {
            title: String::new(),
            head: printed.head.clone(),
            words: printed.words,
            rows: printed.rows.iter().map(row).collect(),
            notes: printed.notes.clone(),
        }
    }
}

/// The budget of every agent in every environment; `None` where the study has no trial.
pub(super) fn sheet(study: &StudyInfo, results: &Results) -> Option<Sheet> {
    if let Some(told) = &results.told {
        return told.budgets.as_ref().map(Sheet::from);
    }
    let budgets = budgets(results);
    let several = budgets
        .iter()
        .any(|budget| budget.environment != budgets[0].environment);
    let head = HEAD
        .into_iter()
        .skip(usize::from(!several))
        .map(String::from)
        .collect();
    let rows = budgets
        .iter()
        .map(|budget| budget.row(study).split_off(usize::from(!several)))
        .collect();
    let notes = notes(&budgets, results);
    (!budgets.is_empty()).then(|| Sheet {
        title: String::new(),
        head,
        words: 1 + usize::from(several),
        rows,
        notes,
    })
}

/// A sentence for every agent that learns and made no update, per environment.
pub(super) fn untrained(results: &Results) -> Vec<String> {
    let sentence = |budget: &Budget<'_>| {
        let (none, of) = (budget.untrained(), budget.ok().count());
        (none > 0).then(|| {
            format!(
                "`{}` in `{}`: 0 updates in {none} of {of} trials: not trained.",
                budget.agent, budget.environment
            )
        })
    };
    budgets(results).iter().filter_map(sentence).collect()
}

/// The cost of all trials.
pub(super) fn cost(results: &Results) -> Cost {
    if let Some(told) = &results.told {
        return told.cost;
    }
    Cost::of(
        results
            .prepared
            .iter()
            .chain(&results.tried)
            .chain(&results.trials),
    )
}

/// Budgets in the order of the plan; all pairings of a play are one.
fn budgets(results: &Results) -> Vec<Budget<'_>> {
    let mut budgets: Vec<Budget<'_>> = Vec::new();
    let mut places: BTreeMap<(&str, &str), usize> = BTreeMap::new();
    for trial in results
        .prepared
        .iter()
        .chain(&results.tried)
        .chain(&results.trials)
    {
        let is_play = matches!(trial.trial.cell.purpose, Purpose::Play(_));
        let agent = if is_play {
            "all casts"
        } else {
            &trial.trial.cell.agent
        };
        // The name of a search, or of an entry of `prepare`, stands for the environment.
        let environment = match &trial.trial.cell.purpose {
            Purpose::Tried(search) => search,
            _ => trial.trial.cell.environment.as_str(),
        };
        let place = *places.entry((environment, agent)).or_insert(budgets.len());
        if place == budgets.len() {
            budgets.push(Budget {
                environment,
                agent,
                trials: Vec::new(),
            });
        }
        budgets[place].trials.push(trial);
    }
    budgets
}

impl Budget<'_> {
    fn row(&self, study: &StudyInfo) -> Vec<SheetEntry> {
        let cost = Cost::of(self.trials.iter().copied());
        let mut row = vec![
            SheetEntry::plain(self.environment),
            SheetEntry::plain(if self.is_imported() {
                marked(self.agent)
            } else {
                self.agent.to_owned()
            }),
            self.count(),
        ];
        row.extend([self.steps(study.learners.contains(self.agent)), self.updates()]);
        row.extend([Phase::Evaluate, Phase::Final].map(|phase| SheetEntry::plain(self.episodes(phase))));
        row.push(SheetEntry::plain(cost.mean().map_or(NONE.into(), duration)));
        row.push(SheetEntry::plain(if cost.trials > 0 {
            duration(cost.seconds)
        } else {
            NONE.into()
        }));
        row
    }

    fn is_imported(&self) -> bool {
        self.trials.iter().any(|trial| trial.is_imported())
    }

    fn ok(&self) -> impl Iterator<Item = &TrialResult> {
        self.trials.iter().copied().filter(|trial| trial.is_ok())
    }

    fn count(&self) -> SheetEntry {
        let (ok, all) = (self.ok().count(), self.trials.len());
        SheetEntry::plain(if ok == all {
            all.to_string()
        } else {
            format!("{ok} of {all} ok")
        })
    }

    /// Trials that ended well and whose agent learns, but made no update.
    fn untrained(&self) -> usize {
        self.ok().filter(|trial| trial.updates() == Some(0.0)).count()
    }

    /// Steps behind the learning of the agent: those up to its last measurement.
    fn steps(&self, learns: bool) -> SheetEntry {
        let learning = self.ok().filter(|trial| learns || trial.trains());
        let last = |trial: &TrialResult| {
            trial
                .rows
                .iter()
                .filter(|row| row.phase == Phase::Final)
                .map(|row| row.step)
                .max()
        };
        #[allow(clippy::cast_precision_loss, reason = "a budget is far below 2^52 steps")]
        let steps = learning.filter_map(last).map(|steps| steps as f64);
        SheetEntry::plain(range(steps))
    }

    fn updates(&self) -> SheetEntry {
        let text = range(self.ok().filter_map(TrialResult::updates));
        match self.untrained() {
            0 => SheetEntry::plain(text),
            _ => SheetEntry::of(Tone::Alarm, text + NOT_TRAINED),
        }
    }

    /// Measurements and their episodes, as in `21 × 100`; a range where trials differ.
    fn episodes(&self, phase: Phase) -> String {
        let counted: Vec<(usize, usize)> = self.ok().map(|trial| measured(trial, phase)).collect();
        let same = counted.windows(2).all(|pair| pair[0] == pair[1]);
        match counted.first() {
            Some((measurements, episodes))
                if same && *measurements > 1 && episodes.is_multiple_of(*measurements) =>
            {
                format!("{measurements} × {}", episodes / measurements)
            }
            #[allow(
                clippy::cast_precision_loss,
                reason = "a trial has far fewer than 2^52 episodes"
            )]
            _ => range(
                counted
                    .iter()
                    .map(|(_, episodes)| *episodes as f64)
                    .filter(|episodes| *episodes > 0.0),
            ),
        }
    }
}

/// Number of measurements of a phase in a trial, and number of episodes in all of them.
fn measured(trial: &TrialResult, phase: Phase) -> (usize, usize) {
    let (mut measurements, mut episodes, mut last) = (0, 0, None);
    for row in trial.select(phase, EPISODE_LENGTH) {
        measurements += usize::from(last != Some(row.step));
        episodes += 1;
        last = Some(row.step);
    }
    (measurements, episodes)
}

/// The smallest and the largest of whole numbers, or the one number where they are equal.
fn range(numbers: impl Iterator<Item = f64>) -> String {
    let ends = numbers.fold(None, |ends: Option<(f64, f64)>, number| {
        Some(ends.map_or((number, number), |(low, high)| {
            (low.min(number), high.max(number))
        }))
    });
    match ends {
        None => NONE.into(),
        Some((low, high)) if low == high => format!("{low:.0}"),
        Some((low, high)) => format!("{low:.0}–{high:.0}"),
    }
}

fn notes(budgets: &[Budget<'_>], results: &Results) -> Vec<String> {
    let settings = results
        .trials
        .iter()
        .any(|trial| !trial.trial.cell.point.is_empty());
    let over = if settings { "seeds and settings" } else { "seeds" };
    let mut notes = untrained(results);
    notes.push(format!(
        "Steps are those that an agent learned from (examples, where it was given examples); episodes are \
         measured ones, in \
         measurements × episodes where there were several. Ranges are over {over}. Agents that do not learn \
         record no number of \
         updates."
    ));
    if !results.repeated.is_empty() {
        notes.push(
            "Whether a program repeats is known from one of its trials, which was computed twice up to the first \
             measurement."
                .into(),
        );
    }
    if budgets.iter().any(|budget| budget.agent == "all casts") {
        notes.push("Casts of a play are policies that other trials trained.".into());
    }
    notes.push(format!(
        "All trials together: {}. Times are wall-clock times of trials, each on one core; of a trial that \
         was interrupted it is \
         the time since it last went on.",
        cost(results).sentence()
    ));
    notes
}

#[cfg(test)]
mod tests {
    use super::*;
    use contract::{standard_metrics::UPDATES, trial_end::EndState};
    use testing::{
        encounters::encounter,
        synthetic::{Rows, ended, trial},
    };

    fn learner(seed: u64, setting: &str, steps: u64, updates: f64) -> TrialResult {
        let mut rows: Rows = vec![(Phase::Final, steps, 0, UPDATES, updates)];
        rows.extend((0..3).flat_map(|k| {
            (0..2).map(move |episode| (Phase::Evaluate, 10 * k, episode, EPISODE_LENGTH, 5.0))
        }));
        rows.extend((0..8).map(|episode| (Phase::Final, steps, episode, EPISODE_LENGTH, 5.0)));
        let mut result = trial("tank", "learner", setting, seed, &rows);
        result.trial_mut().id = format!("{seed}-{setting}");
        result
    }

    fn texts(results: &Results) -> Vec<Vec<String>> {
        sheet(&StudyInfo::default(), results)
            .unwrap()
            .rows
            .iter()
            .map(|row| row.iter().map(|entry| entry.text.clone()).collect())
            .collect()
    }

    #[test]
    fn budgets_are_ranges_over_seeds() {
        let rule = trial(
            "tank",
            "rule",
            "",
            0,
            &vec![(Phase::Final, 0, 0, EPISODE_LENGTH, 5.0)],
        );
        let failed = ended(learner(2, "", 20, 3.0), EndState::Oom, "too large");
        let results = Results::of(vec![
            learner(0, "", 20, 3.0),
            learner(1, "", 20, 4.0),
            failed,
            rule,
        ]);
        let expected = [
            [
                "learner",
                "2 of 3 ok",
                "20",
                "3–4",
                "3 × 2",
                "8",
                "1.0 s",
                "3.0 s",
            ],
            ["rule", "1", "–", "–", "–", "1", "1.0 s", "1.0 s"],
        ];
        assert_eq!(texts(&results), expected);
        assert_eq!(cost(&results).sentence(), "4.0 s in 4 trials");
        assert!(untrained(&results).is_empty());
    }

    #[test]
    fn learners_that_record_no_number_of_updates_still_have_their_steps() {
        let results = Results::of(vec![trial(
            "tank",
            "estimator",
            "",
            0,
            &vec![(Phase::Final, 512, 0, "bias", 0.1)],
        )]);
        let study = StudyInfo {
            learners: ["estimator".to_owned()].into(),
            ..StudyInfo::default()
        };
        let row = sheet(&study, &results).unwrap().rows.remove(0);
        assert_eq!([row[2].text.as_str(), row[3].text.as_str()], ["512", "–"]);
    }

    #[test]
    fn agents_without_updates_are_flagged() {
        let results = Results::of(vec![learner(0, "", 20, 0.0), learner(1, "", 20, 4.0)]);
        let row = &sheet(&StudyInfo::default(), &results).unwrap().rows[0];
        assert_eq!(row[3], SheetEntry::of(Tone::Alarm, "0–4: not trained"));
        assert_eq!(
            untrained(&results),
            ["`learner` in `tank`: 0 updates in 1 of 2 trials: not trained."]
        );
    }

    #[test]
    fn what_was_computed_once_costs_once_and_settings_make_ranges() {
        let mut shared = learner(0, "rate=0.1", 20, 3.0);
        shared.trial_mut().cell_mut().combination.point =
            contract::sweep_point::SweepPoint::of_words("rate=0.2");
        let results = Results::of(vec![
            learner(0, "rate=0.1", 20, 3.0),
            shared,
            learner(0, "rate=0.3", 40, 6.0),
        ]);
        assert_eq!(
            texts(&results),
            [["learner", "3", "20–40", "3–6", "3 × 2", "8", "1.0 s", "2.0 s"]]
        );
        assert!(sheet(&StudyInfo::default(), &results).unwrap().notes[0].contains("seeds and settings"));
    }

    #[test]
    fn the_casts_of_a_play_are_one_row_and_nothing_is_none() {
        let results = Results::of(vec![
            encounter("a", "a", 0, 1.0),
            encounter("a", "b", 0, 1.0),
            learner(0, "", 20, 3.0),
        ]);
        let rows = texts(&results);
        assert_eq!(
            (rows[0][0].as_str(), rows[0][1].as_str(), rows[0][2].as_str()),
            ("pursuit", "all casts", "2")
        );
        assert_eq!(sheet(&StudyInfo::default(), &Results::default()), None);
    }

    #[test]
    fn times_have_the_unit_that_suits_them() {
        assert_eq!(
            [0.04, 9.97, 89.0, 90.0, 5399.0, 5400.0].map(duration),
            ["0.0 s", "10 s", "89 s", "2 min", "90 min", "1.5 h"]
        );
    }
}
