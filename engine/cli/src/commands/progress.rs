//! Shows progress: bars on a terminal, plain lines elsewhere.
//!
//! Bars have the width of the terminal; titles are cut if it is narrow. No time is estimated before the first step is
//! done, and steps before a resumption do not count into the rate of a trial.

use super::console::{complain, shown};
use contract::trial_end::{EndState, TrialEnd};
use document::{
    count::{count, duration},
    plain_text::printable,
};
use execution::{
    scheduler::{Event, Task},
    store::Owner,
};
use indicatif::{HumanDuration, MultiProgress, ProgressBar, ProgressState, ProgressStyle};
use session::Follower;
use std::{collections::BTreeSet, fmt::Write, io::IsTerminal, time::Duration};

/// The progress of the run that was shown so far.
pub(super) struct ProgressDisplay<'a> {
    tasks: &'a [Task<'a>],
    done: usize,
    /// Trials that other programs run; each is reported once.
    held: BTreeSet<usize>,
    /// Messages about missing sources; each is printed once even if several trials take from the source.
    lacking: BTreeSet<String>,
    bars: Option<Bars>,
}

struct Bars {
    all: MultiProgress,
    study: ProgressBar,
    slots: Vec<ProgressBar>,
    /// Slots whose trial has not reported its first step yet.
    fresh: BTreeSet<usize>,
}

impl<'a> ProgressDisplay<'a> {
    /// Begins to show the run of `tasks` on `workers` slots.
    pub(super) fn new(tasks: &'a [Task<'a>], workers: usize) -> Self {
        let bars = std::io::stderr()
            .is_terminal()
            .then(|| Bars::new(tasks.len() as u64, workers));
        Self {
            tasks,
            done: 0,
            held: BTreeSet::new(),
            lacking: BTreeSet::new(),
            bars,
        }
    }

    /// Shows a line above the bars.
    fn print(&self, text: &str) {
        match &self.bars {
            // A terminal that cannot show the line still has the bars.
            Some(bars) => drop(bars.all.println(shown(text))),
            None => complain(text),
        }
    }

    fn started(&mut self, slot: usize, trial: usize) {
        let Some(bars) = &mut self.bars else { return };
        bars.fresh.insert(slot);
        if let Some(bar) = bars.slots.get(slot) {
            bar.reset();
            bar.set_message(printable(&self.tasks[trial].trial.title()).into_owned());
        }
    }

    fn advanced(&mut self, slot: usize, done: u64, total: u64) {
        let Some(bars) = &mut self.bars else { return };
        let goes_on = bars.fresh.remove(&slot);
        if let Some(bar) = bars.slots.get(slot) {
            bar.set_length(total);
            bar.set_position(done);
            if goes_on {
                bar.reset_eta();
            }
        }
    }

    /// A slot has left its trial, because the run is stopping.
    fn stopped(&self, slot: usize) {
        if let Some(bar) = self.bars.as_ref().and_then(|bars| bars.slots.get(slot)) {
            bar.finish_and_clear();
        }
    }

    fn retried(&self, trial: usize, end: &TrialEnd, wait: Duration) {
        let title = self.tasks[trial].trial.title();
        self.print(&format!(
            "{:<8} {title}: {}; tried again in {:.1} s",
            end.state.name(),
            end.reason,
            wait.as_secs_f64()
        ));
    }

    fn lost(&self, slot: usize, problem: &str, wait: Option<Duration>) {
        let then = wait.map_or_else(
            || "it is given up".to_owned(),
            |wait| format!("looked after again in {:.0} s", wait.as_secs_f64()),
        );
        self.print(&format!(
            "worker {slot}: {problem}; its trial goes to the others; {then}"
        ));
    }

    fn held(&mut self, trial: usize, owner: &Owner) {
        if self.held.insert(trial) {
            let job = owner
                .slurm_job
                .as_ref()
                .map_or_else(String::new, |job| format!(", Slurm job {job}"));
            let title = self.tasks[trial].trial.title();
            self.print(&format!(
                "waiting for {title}: process {} on {}{job} has it",
                owner.pid, owner.host
            ));
        }
    }

    fn awaits(&mut self, trial: usize, source: &str, owner: &Owner) {
        if self.lacking.insert(source.to_owned()) {
            let title = self.tasks[trial].trial.title();
            self.print(&format!(
                "{title} waits for trial {source}: process {} on {} has it",
                owner.pid, owner.host
            ));
        }
    }

    fn block(&mut self, trial: usize, reason: &str) {
        if self.lacking.insert(reason.to_owned()) {
            self.print(&format!("blocked  {}: {reason}", self.tasks[trial].trial.title()));
        }
    }

    fn ended(&mut self, slot: Option<usize>, trial: usize, end: &TrialEnd) {
        self.done += 1;
        let reason = if end.reason.is_empty() {
            String::new()
        } else {
            format!(": {}", end.reason)
        };
        let (title, wall_s) = (self.tasks[trial].trial.title(), end.wall_s);
        let by = if slot.is_none() {
            ", by another program"
        } else {
            ""
        };
        if self.bars.is_none() || end.state != EndState::Ok {
            let width = self.tasks.len().to_string().len();
            self.print(&format!(
                "[{:>width$}/{}] {:<8} {title} ({wall_s:.1} s{by}){reason}",
                self.done,
                self.tasks.len(),
                end.state.name()
            ));
        }
        if let Some(bars) = &self.bars {
            bars.study.inc(1);
            if let Some(bar) = slot.and_then(|slot| bars.slots.get(slot)) {
                bar.set_message("idle");
            }
        }
    }

    fn paused(&mut self, slot: usize, trial: usize) {
        self.done += 1;
        let task = &self.tasks[trial];
        if self.bars.is_none() {
            let (width, step) = (self.tasks.len().to_string().len(), task.until.unwrap_or_default());
            let (done, all) = (self.done, self.tasks.len());
            self.print(&format!(
                "[{done:>width$}/{all}] paused   {} at step {step}",
                task.trial.title()
            ));
        }
        if let Some(bars) = &self.bars {
            bars.study.inc(1);
            bars.slots
                .get(slot)
                .into_iter()
                .for_each(|bar| bar.set_message("idle"));
        }
    }
}

impl Follower for ProgressDisplay<'_> {
    fn hear(&mut self, event: &Event) {
        match event {
            Event::Started { slot, trial } => self.started(*slot, *trial),
            Event::Progress { slot, done, total } => self.advanced(*slot, *done, *total),
            Event::Ended { slot, trial, end } => self.ended(Some(*slot), *trial, end),
            Event::EndedElsewhere { trial, end } => self.ended(None, *trial, end),
            Event::Retried { trial, end, wait, .. } => self.retried(*trial, end, *wait),
            Event::Held { trial, owner } => self.held(*trial, owner),
            Event::Awaits { trial, source, owner } => self.awaits(*trial, source, owner),
            Event::Unready { trial, reason } => self.block(*trial, reason),
            Event::Obstructed { trial, reason } => {
                let title = self.tasks[*trial].trial.title();
                self.print(&format!("passed over {title}: {reason}"));
            }
            Event::Stopped { slot } => self.stopped(*slot),
            Event::Paused { slot, trial } => self.paused(*slot, *trial),
            Event::Lost { slot, problem, wait } => self.lost(*slot, problem, *wait),
            Event::Broken { slot, problem } => self.print(&format!("worker {slot} cannot go on: {problem}")),
        }
    }

    fn line(&mut self, text: &str) {
        self.print(text);
    }
}

impl Drop for ProgressDisplay<'_> {
    fn drop(&mut self) {
        // The bars leave the screen; one line remains.
        if let Some(bars) = &self.bars {
            bars.slots.iter().for_each(ProgressBar::finish_and_clear);
            bars.study.finish_and_clear();
            let (all, took) = (self.tasks.len(), bars.study.elapsed());
            let took = duration(took.as_secs_f64());
            complain(&format!(
                "{} of {} ended in {took}",
                self.done,
                count(all, "trial")
            ));
        }
    }
}

impl Bars {
    fn new(trials: u64, workers: usize) -> Self {
        let all = MultiProgress::new();
        let study = all.add(
            ProgressBar::new(trials).with_style(style("{bar:20} {pos}/{len} trials  {elapsed} so far{left}")),
        );
        study.enable_steady_tick(std::time::Duration::from_millis(500));
        let slot = || {
            all.add(ProgressBar::new(0).with_style(style(
                "{bar:20.dim} {wide_msg} {human_pos}/{human_len} steps{rate}{left}",
            )))
        };
        let slots = (0..workers.min(usize::try_from(trials).unwrap_or(usize::MAX)))
            .map(|_| slot())
            .collect();
        Self {
            all,
            study,
            slots,
            fresh: BTreeSet::new(),
        }
    }
}

fn style(template: &str) -> ProgressStyle {
    // The templates are the constants above.
    ProgressStyle::with_template(template)
        .expect("a valid template")
        .with_key("rate", |state: &ProgressState, out: &mut dyn Write| {
            // A terminal that accepts no text shows none.
            let _ = out.write_str(&rate(state.per_sec()));
        })
        .with_key("left", |state: &ProgressState, out: &mut dyn Write| {
            let _ = out.write_str(&left(state.eta()));
        })
        .progress_chars("━╸─")
}

/// Steps per second with three digits; empty before a rate is known.
fn rate(per_second: f64) -> String {
    if !per_second.is_finite() || per_second <= 0.0 {
        return String::new();
    }
    let decimals = match per_second {
        100.0.. => 0,
        10.0.. => 1,
        _ => 2,
    };
    format!(", {per_second:.decimals$}/s")
}

/// The remaining time; empty if it cannot be estimated.
fn left(estimate: Duration) -> String {
    match estimate.as_secs() {
        0 => String::new(),
        seconds => format!(", {} left", HumanDuration(Duration::from_secs(seconds))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_have_three_digits_and_nothing_is_said_before_anything_is_known() {
        let shown = [0.0, f64::INFINITY, 0.1234, 12.345, 1234.56].map(rate);
        assert_eq!(shown, ["", "", ", 0.12/s", ", 12.3/s", ", 1235/s"]);
        let shown = [0, 61, 7200].map(|seconds| left(Duration::from_secs(seconds)));
        assert_eq!(shown, ["", ", 61 seconds left", ", 2 hours left"]);
    }
}
