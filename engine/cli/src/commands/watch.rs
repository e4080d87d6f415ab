//! `watch`: running trials and learning curves in a terminal, as a page, or once as text.

use super::{
    Common, Format, Studies, complain,
    console::{colour, listen_for_signals, terminal_width},
    say,
};
use crate::watch::{Focus, View, Watched, Watcher, draw, page, plain};
use analysis::search::Direction;
use clap::Args;
use contract::{Better, Error, Registry};
use document::diagnostic::suggest;
use execution::{
    store::{self, write_durably},
    world::{clock, fs},
};
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use session::{Exit, Failure, Planned, Session};
use std::{
    collections::BTreeSet,
    io::IsTerminal,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

/// The studies to watch, and the form of the view.
#[derive(Debug, Clone, Args)]
pub(super) struct WatchOptions {
    #[command(flatten)]
    studies: Studies,
    /// Write a page with the curves repeatedly until no trial is left, instead of the terminal view.
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Print once as text and leave; the default if standard output is no terminal.
    #[arg(long)]
    once: bool,
    /// Metric that is shown first; where absent, that of the study's learning curves.
    #[arg(long, value_name = "NAME")]
    metric: Option<String>,
    /// Seconds between two reads of the store.
    #[arg(long, value_name = "SECONDS", default_value_t = 2.0, value_parser = seconds)]
    every_s: f64,
}

/// After each look the watcher rests for at least this many times the duration of the look, however large the store is.
const REST_PER_LOOK: u32 = 5;
/// Longest reaction time to a key.
const KEY_WAIT: Duration = Duration::from_millis(100);
/// Number of looks after which studies that grow are planned again.
const LOOKS_PER_PLAN: u64 = 10;

fn seconds(text: &str) -> Result<f64, String> {
    let number = text
        .parse::<f64>()
        .ok()
        .filter(|number| (0.1..=3600.0).contains(number));
    number.ok_or_else(|| "write a number from 0.1 to 3600".into())
}

/// Exit code 0 whatever the trials did; 2 if a study is wrong.
pub(super) fn watch(registry: &Registry, options: &WatchOptions, common: &Common) -> Result<Exit, Failure> {
    let session = options.studies.open_here(registry, common)?;
    let planned = session.load_with_looks()?;
    if let Some(name) = &options.metric {
        refuse_unknown(name, &planned)?;
    }
    let preferred = options
        .metric
        .iter()
        .cloned()
        .chain(planned.iter().flat_map(metrics))
        .collect();
    let mut watching = Watching {
        options,
        watcher: Watcher::new(
            session.store()?.clone(),
            session.settings.workers,
            preferred,
            less_is_better(&planned),
        ),
        session,
        planned,
        looks: 0,
    };
    let stop = Arc::new(AtomicBool::new(false));
    if let Some(path) = &options.html {
        listen_for_signals(&stop)?;
        return watching.write_pages(path, &stop);
    }
    let is_terminal = std::io::stdout().is_terminal() && common.format == Format::Text;
    if options.once || !is_terminal {
        let view = watching.look();
        say(&match common.format {
            Format::Text => plain(&view, u16::try_from(terminal_width()).unwrap_or(u16::MAX)),
            Format::Json => serde_json::to_string(&view).map_err(|error| Failure {
                exit: Exit::BadStudy,
                text: format!("error: {error}"),
            })?,
        });
        return Ok(Exit::Ok);
    }
    listen_for_signals(&stop)?;
    let terminal = ratatui::try_init().map_err(broken)?;
    // After a panic the hook that was installed with the terminal restores it.
    let shown = watching.show(terminal, &stop);
    ratatui::restore();
    shown
}

/// Refuses a metric that no trial of the studies records.
fn refuse_unknown(metric: &str, planned: &[Planned]) -> Result<(), Failure> {
    let known = planned.iter().flat_map(|one| &one.study.metrics);
    let known: BTreeSet<&str> = known.map(|it| it.name.as_str()).collect();
    if known.contains(metric) {
        return Ok(());
    }
    let help = suggest(metric, known);
    Err(Failure {
        exit: Exit::BadStudy,
        text: format!("error: --metric {metric}: no trial records `{metric}`: {help}"),
    })
}

fn broken(error: std::io::Error) -> Failure {
    Failure {
        exit: Exit::Incomplete,
        text: format!("error: cannot use the terminal: {error}; `--once` prints text"),
    }
}

/// Metrics for which lower values are better, from the definitions in studies and from searches that minimize.
fn less_is_better(planned: &[Planned]) -> BTreeSet<String> {
    let of_study = |one: &Planned| -> Vec<String> {
        let metrics = one.study.metrics.iter().filter(|it| it.better == Better::Lower);
        let searches = one.study.searches.iter().map(|(search, _)| search);
        let minimized = searches.filter(|search| search.direction == Direction::Minimize);
        let minimized = minimized.map(|search| search.metric.clone());
        metrics.map(|it| it.name.clone()).chain(minimized).collect()
    };
    planned.iter().flat_map(of_study).collect()
}

/// Metrics that a study shows in learning curves, compares settings by and has in tables, in this order.
fn metrics(one: &Planned) -> Vec<String> {
    let curves = one
        .study
        .figures
        .iter()
        .filter_map(|(_, figure)| figure.kind.followed_metric().map(str::to_owned));
    let searches = one.study.searches.iter().map(|(search, _)| search.metric.clone());
    let tables = one.study.tables.iter();
    let tables = tables.filter_map(|(_, table)| table.kind.metric_of_unit().map(str::to_owned));
    curves.chain(searches).chain(tables).collect()
}

struct Watching<'a> {
    session: Session<'a>,
    options: &'a WatchOptions,
    watcher: Watcher,
    planned: Vec<Planned>,
    looks: u64,
}

impl Watching<'_> {
    /// The trials as they are now. Studies whose trials depend on results are planned again periodically; while a study
    /// cannot be read because it is being edited, the last plan stays in use.
    fn look(&mut self) -> View {
        let grows = |one: &Planned| one.study.design.is_some() || !one.study.searches.is_empty();
        if self.looks > 0 && self.looks.is_multiple_of(LOOKS_PER_PLAN) && self.planned.iter().any(grows) {
            let again = self.session.load_with_looks();
            self.planned = again.unwrap_or_else(|_| std::mem::take(&mut self.planned));
        }
        self.looks += 1;
        let watched = self.planned.iter().map(|one| Watched {
            name: &one.study.name,
            trials: &one.plan.trials,
            costs: &one.costs,
        });
        self.watcher.look(&watched.collect::<Vec<_>>(), store::now())
    }

    /// A look, and the time of the next one.
    fn look_timed(&mut self) -> (View, Instant) {
        let begun = clock::now();
        let view = self.look();
        let every = Duration::from_secs_f64(self.options.every_s);
        (
            view,
            clock::now() + every.max(clock::since(begun) * REST_PER_LOOK),
        )
    }

    /// Writes pages until no trial is left or a signal asks to leave.
    fn write_pages(&mut self, path: &Path, stop: &AtomicBool) -> Result<Exit, Failure> {
        loop {
            let (view, next) = self.look_timed();
            let last = self.options.once || view.is_finished() || stop.load(Ordering::SeqCst);
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "from 1 to 3600"
            )]
            let refresh_s = (!last).then(|| self.options.every_s.ceil() as u64);
            write_page(path, &page(&view, refresh_s)?)?;
            if last {
                return Ok(Exit::Ok);
            }
            if self.looks == 1 {
                complain(&format!(
                    "`{}` is renewed until no trial is left; Ctrl-C leaves",
                    path.display()
                ));
            }
            while clock::now() < next && !stop.load(Ordering::SeqCst) {
                clock::sleep(KEY_WAIT);
            }
        }
    }

    fn show(&mut self, mut terminal: ratatui::DefaultTerminal, stop: &AtomicBool) -> Result<Exit, Failure> {
        let mut choice = Focus {
            colours: colour(),
            keys: true,
            ..Focus::default()
        };
        let (mut view, mut next) = self.look_timed();
        loop {
            terminal
                .draw(|frame| draw(frame, &view, choice))
                .map_err(broken)?;
            if event::poll(KEY_WAIT).map_err(broken)? {
                match event::read().map_err(broken)? {
                    Event::Key(key) if key.kind == KeyEventKind::Press && leaves(key) => return Ok(Exit::Ok),
                    Event::Key(key) if key.kind == KeyEventKind::Press => choice = turned(choice, key.code),
                    _ => {}
                }
            }
            if stop.load(Ordering::SeqCst) {
                return Ok(Exit::Ok);
            }
            if clock::now() >= next {
                (view, next) = self.look_timed();
            }
        }
    }
}

fn leaves(key: KeyEvent) -> bool {
    let with_control = key.modifiers.contains(KeyModifiers::CONTROL);
    match key.code {
        KeyCode::Char('q') | KeyCode::Esc => true,
        KeyCode::Char('c') => with_control,
        _ => false,
    }
}

/// The view that a key chooses.
fn turned(choice: Focus, key: KeyCode) -> Focus {
    let (panel, metric, scroll) = (choice.panel, choice.metric, choice.scroll);
    match key {
        KeyCode::Right | KeyCode::Tab => Focus {
            panel: panel.wrapping_add(1),
            ..choice
        },
        KeyCode::Left => Focus {
            panel: panel.saturating_sub(1),
            ..choice
        },
        KeyCode::Char('m') => Focus {
            metric: metric.wrapping_add(1),
            ..choice
        },
        KeyCode::Down => Focus {
            scroll: scroll.saturating_add(1),
            ..choice
        },
        KeyCode::Up => Focus {
            scroll: scroll.saturating_sub(1),
            ..choice
        },
        _ => choice,
    }
}

/// Writes the page atomically, and creates its folder if needed.
fn write_page(path: &Path, text: &str) -> Result<(), Error> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    if let Some(folder) = folder {
        fs::create_dir_all(folder).map_err(Error::file("create", folder))?;
    }
    write_durably(path, text.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_leave_or_turn_what_is_shown() {
        let key = |code| KeyEvent::new(code, KeyModifiers::NONE);
        assert!(leaves(key(KeyCode::Char('q'))) && leaves(key(KeyCode::Esc)));
        assert!(
            leaves(KeyEvent::new(KeyCode::Char('c'), KeyModifiers::CONTROL))
                && !leaves(key(KeyCode::Char('c')))
        );
        let after = |keys: &[KeyCode]| {
            keys.iter()
                .fold(Focus::default(), |choice, key| turned(choice, *key))
        };
        let choice = after(&[
            KeyCode::Right,
            KeyCode::Right,
            KeyCode::Left,
            KeyCode::Char('m'),
            KeyCode::Up,
            KeyCode::Down,
        ]);
        assert_eq!((choice.panel, choice.metric, choice.scroll), (1, 1, 1));
        assert_eq!(after(&[KeyCode::Left]).panel, 0);
    }

    #[test]
    fn times_between_looks_have_bounds() {
        assert_eq!(seconds("0.5"), Ok(0.5));
        assert!(seconds("0").is_err() && seconds("nan").is_err() && seconds("soon").is_err());
    }
}
