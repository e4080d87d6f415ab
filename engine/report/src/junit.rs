//! Ends of trials as JUnit XML for continuous integration: a suite per study, a test case per trial.
//!
//! A trial whose plugin reported a problem (`failed`, `nan`) is a failure. One that broke or was ended (`panicked`,
//! `timeout`, `oom`, `killed`) is an error, and one that has not run is skipped.

use super::outcome::Outcome;
use contract::{
    Error,
    trial::Trial,
    trial_end::{EndState, TrialEnd},
};
use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};
use std::time::Duration;

/// The document for all studies of a command.
///
/// # Errors
/// [`Error::Render`] where the writer refuses.
pub fn junit(outcomes: &[Outcome], wall_s: f64, exit_code: u8) -> Result<String, Error> {
    let mut report = Report::new("regimen");
    report.set_time(seconds(wall_s));
    report.add_test_suites(outcomes.iter().map(|outcome| suite(outcome, exit_code)));
    report.to_string().map_err(|error| Error::Render {
        what: "JUnit file".into(),
        problem: error.to_string(),
    })
}

fn suite(outcome: &Outcome, exit_code: u8) -> TestSuite {
    let ends = outcome.trials.iter().filter_map(|(_, end)| end.as_ref());
    let mut suite = TestSuite::new(outcome.study.as_str());
    suite.set_time(seconds(ends.map(|end| end.wall_s).sum()));
    suite.add_property(("exit_code", exit_code.to_string().as_str()));
    suite.add_property(("program", concat!("regimen ", env!("CARGO_PKG_VERSION"))));
    for (word, count) in outcome.counts() {
        suite.add_property((word, count.to_string().as_str()));
    }
    let trials = outcome.trials.iter();
    suite.add_test_cases(trials.map(|(trial, end)| case(&outcome.study, trial, end.as_ref())));
    suite
}

fn case(study: &str, trial: &Trial, end: Option<&TrialEnd>) -> TestCase {
    let seed = format!("seed {}", trial.key.seed);
    let words = [trial.cell.agent.as_str(), trial.cell.point.words(), &seed];
    let words: Vec<&str> = words.into_iter().filter(|word| !word.is_empty()).collect();
    let mut case = TestCase::new(text(&words.join("/")), status(end));
    case.set_classname(format!("{study}.{}", trial.cell.environment));
    case.set_time(seconds(end.map_or(0.0, |end| end.wall_s)));
    case.add_property(("id", trial.id.as_str()));
    case
}

fn status(end: Option<&TrialEnd>) -> TestCaseStatus {
    let Some(end) = end else {
        let mut status = TestCaseStatus::skipped();
        status.set_message("has not run");
        return status;
    };
    let mut status = match end.state {
        EndState::Ok => return TestCaseStatus::success(),
        EndState::Failed | EndState::Nan => TestCaseStatus::non_success(NonSuccessKind::Failure),
        EndState::Panicked | EndState::Timeout | EndState::Oom | EndState::Killed => {
            TestCaseStatus::non_success(NonSuccessKind::Error)
        }
        EndState::Paused => TestCaseStatus::skipped(),
    };
    status.set_message(text(&end.reason));
    status.set_type(end.state.name());
    status.set_description(text(&end.reason));
    status
}

/// A text without the two characters that XML cannot hold and the writer does not escape.
fn text(text: &str) -> String {
    text.replace(['\u{fffe}', '\u{ffff}'], "\u{fffd}")
}

/// A wall time as a duration; stored times are never negative.
fn seconds(wall_s: f64) -> Duration {
    Duration::try_from_secs_f64(wall_s).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::{super::outcome::tests::one_of_each, *};

    #[test]
    fn the_document() {
        insta::assert_snapshot!("junit", junit(&[one_of_each()], 12.5, 106).unwrap());
    }

    #[test]
    fn what_is_written_can_be_read_back() {
        let outcome = one_of_each();
        let text = junit(&[outcome.clone(), outcome], 12.5, 106).unwrap();
        let read = Report::deserialize_from_str(&text).unwrap();
        let counts = (read.tests, read.failures, read.errors, read.skipped);
        assert_eq!(counts, (16, 4, 8, 2));
        let suite = &read.test_suites[0];
        assert_eq!(suite.name.as_str(), "small & <odd>");
        let second = &suite.test_cases[1];
        assert_eq!(second.name.as_str(), "equal/rate=0.1 note=\"<&>\"/seed 1");
        let failures = suite.test_cases.iter().filter_map(|case| match &case.status {
            TestCaseStatus::NonSuccess { message, ty, .. } => Some((message.as_deref()?, ty.as_deref()?)),
            _ => None,
        });
        assert!(
            failures
                .into_iter()
                .any(|it| it == ("5 < 3 & \"so on\" ]]>\u{fffd}", "failed"))
        );
    }
}
