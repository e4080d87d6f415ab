//! Pictures of what is hard to draw: runs at steps of their own, numbers of any size, letters that fonts lack,
//! long logs. Each makes a report, shows as many runs as it says, and tells what it does not show.

use crate::program::{Answer, Bench};
use std::{fmt::Write as _, fs};

/// Two trials of a rule, which take no time, and runs of another program.
const STUDY: &str = "
study: pictures
environments: { env: { pendulum: {} } }
agents: { rule: { zero_action: {} } }
protocol: { train_evaluate: { steps: 200, evaluate_every: 100, episodes: 1, final_episodes: 1, environments: 2, trace_episodes: 0 } }
seeds: 2
";

const IMPORTED: &str = "imported: { theirs: { from: \"runs/*.csv\", metrics: { return: return } } }
tables: { final: { comparison: { rows: agent, value: return, agents: [theirs] } } }
";

/// A study with these sections more, and runs of these steps with values.
fn bench(sections: &str, runs: &[Vec<(u64, f64)>]) -> Bench {
    let bench = Bench::new();
    fs::create_dir(bench.path("runs")).unwrap();
    for (index, run) in runs.iter().enumerate() {
        let mut text = String::from("step,return\n");
        for (step, value) in run {
            writeln!(text, "{step},{value:e}").unwrap();
        }
        bench.write(&format!("runs/{index}.csv"), &text);
    }
    let imported = if runs.is_empty() { "" } else { IMPORTED };
    bench.write("pictures.yaml", &format!("{STUDY}{imported}{sections}"));
    bench
}

fn run(bench: &Bench) -> Answer {
    bench.run(&["run", "pictures.yaml", "-j", "1"])
}

fn read(bench: &Bench, file: &str) -> String {
    fs::read_to_string(bench.path("results/pictures").join(file)).unwrap()
}

/// Number of runs, step and value of each point of the line.
fn line(bench: &Bench) -> Vec<(String, u64, f64)> {
    let text = read(bench, "figures/curve.csv");
    let cells = text
        .lines()
        .skip(1)
        .map(|line| line.split(',').collect::<Vec<_>>());
    cells
        .filter(|cells| cells.last() == Some(&""))
        .map(|cells| {
            (
                cells[2].to_owned(),
                cells[3].parse().unwrap(),
                cells[4].parse().unwrap(),
            )
        })
        .collect()
}

const CURVE: &str = "figures: { curve: { learning_curve: { agents: [theirs] } } }";

#[test]
fn runs_at_steps_of_their_own_are_all_behind_every_point_of_a_line() {
    let runs = |shift: u64, value: f64| (0..=10).map(|at| (100 * at + shift, value)).collect();
    let bench = bench(CURVE, &[runs(0, 0.0), runs(50, 10.0)]);
    assert_eq!(run(&bench).code, 0);
    let line = line(&bench);
    assert_eq!((line[0].1, line[line.len() - 1].1), (50, 1000));
    assert!(
        line.iter().all(|(n, _, value)| n == "2" && *value == 5.0),
        "{line:?}"
    );
    let report = read(&bench, "report.md");
    assert!(
        report.contains("Last values: theirs (imported) 5.000."),
        "{report}"
    );
    assert!(report.contains("| 5.000 ["), "{report}");
    let note = "count at each step with their last value up to it. The line of theirs (imported) goes from step 50 to 1000, \
                where all n = 2 runs have values; single runs go from 0 to 1050.";
    assert!(report.contains(note), "{report}");
}

#[test]
fn a_line_ends_with_the_first_of_its_runs_and_the_last_values_are_those_of_the_table() {
    let runs: Vec<Vec<(u64, f64)>> = (0..7)
        .map(|run| {
            let last = if run == 3 { 40 } else { 100 };
            (0..=last)
                .step_by(10)
                .map(|step| (step, (step + run) as f64))
                .collect()
        })
        .collect();
    let bench = bench(CURVE, &runs);
    assert_eq!(run(&bench).code, 0);
    let line = line(&bench);
    assert_eq!(line.last().unwrap(), &("7".into(), 40, 43.0));
    // The last values are 43 and 100, 101, 102, 104, 105, 106; beyond the end of the line the single runs are drawn.
    let report = read(&bench, "report.md");
    assert!(
        report.contains("Last values: theirs (imported) 94.43"),
        "{report}"
    );
    assert!(report.contains("| 94.43 ["), "{report}");
    let data = read(&bench, "figures/curve.csv");
    assert!(data.lines().any(|line| line.contains(",100,106,")), "{data}");
}

#[test]
fn a_logarithmic_axis_holds_numbers_of_any_size_and_says_what_it_leaves_out() {
    let curve = "figures: { curve: { learning_curve: { agents: [theirs], log_y: true } } }";
    let ranges: [&[f64]; 6] = [
        &[1e-308, 1.0],
        &[5e-324, 1.7e308],
        &[-1e300, 0.0, 1e300],
        &[3.0, 3.0],
        &[0.0, 0.0],
        &[1e-308, 1e-308],
    ];
    for values in ranges {
        let bench = bench(curve, &[(0..).step_by(50).zip(values.iter().copied()).collect()]);
        let answer = run(&bench);
        assert_eq!(answer.code, 0, "{values:?}: {}", answer.err);
        let svg = read(&bench, "figures/curve.svg");
        assert!(
            svg.matches("<text").count() < 40 && !svg.contains("NaN"),
            "{values:?}"
        );
        let out = values.iter().filter(|value| **value <= 0.0).count();
        let note = format!(
            "{out} of {} points are left out, as a logarithmic axis",
            values.len()
        );
        assert_eq!(read(&bench, "report.md").contains(&note), out > 0, "{values:?}");
    }
}

#[test]
fn letters_that_the_font_lacks_are_named() {
    let figures = "figures: { curve: { learning_curve: {}, labels: { rule: правило }, y_label: 回報 } }";
    let bench = bench(figures, &[]);
    let answer = run(&bench);
    assert_eq!(answer.code, 0, "{}", answer.err);
    let said = "figure `curve`: The font of the PNG and PDF files lacks 回 (U+56DE), 報 (U+5831), in “回報”";
    assert!(answer.err.contains(said), "{}", answer.err);
    assert!(!answer.err.contains("правило"), "{}", answer.err);
    assert!(read(&bench, "report.md").contains("lacks 回 (U+56DE), 報 (U+5831)"));
    assert!(read(&bench, "figures/curve.svg").contains("回報"));
}

#[test]
fn long_logs_make_a_page_of_a_usual_size_and_their_data_lie_beside() {
    let runs = |run: u64| {
        (0..60_000)
            .map(|at| (25 * at + run, ((at * (7 + run)) % 1000) as f64))
            .collect()
    };
    let mut runs: Vec<Vec<(u64, f64)>> = (0..3).map(runs).collect();
    runs[1][30_000].1 = 5000.0;
    let bench = bench(CURVE, &runs);
    assert_eq!(run(&bench).code, 0);
    for (file, most) in [
        ("index.html", 3_000_000),
        ("figures/curve.svg", 1_500_000),
        ("figures/curve.pdf", 1_000_000),
    ] {
        let size = fs::metadata(bench.path("results/pictures").join(file))
            .unwrap()
            .len();
        assert!(size < most, "{file}: {size}");
    }
    let data = read(&bench, "figures/curve.csv");
    assert!(data.lines().count() > 180_000, "{}", data.lines().count());
    // A single peak of a single run is in the line, a third of it.
    let highest = line(&bench)
        .into_iter()
        .map(|(_, _, value)| value)
        .fold(0.0, f64::max);
    assert!(highest > 5000.0 / 3.0, "{highest}");
}

#[test]
fn a_figure_that_cannot_be_made_costs_itself_alone_and_the_exit_code() {
    let runs = [vec![(0, 1.0), (50, 2.0)], vec![(60, 3.0), (90, 4.0)]];
    let figures = "figures: { good: { learning_curve: {} }, bad: { sample_efficiency: { agents: [theirs], \
     normalise: { env: [-2000, 0] } } } }";
    let bench = bench(figures, &runs);
    let answer = run(&bench);
    assert_eq!(answer.code, 102, "{}", answer.err);
    let reason = "no agent has a step at which all its runs have begun and none has ended";
    assert!(answer.out.contains("bad: could not be drawn: "), "{}", answer.out);
    for file in ["index.html", "report.md"] {
        let text = read(&bench, file);
        assert!(
            text.contains("Could not be drawn: ") && text.contains(reason),
            "{file}"
        );
    }
    assert!(read(&bench, "figures/good.svg").contains("<svg"));
    let again = bench.run(&["report", "pictures.yaml", "--format", "json"]);
    let said: serde_json::Value = serde_json::from_str(&again.out).unwrap();
    assert_eq!(again.code, 102);
    assert!(
        said["not_made"]["bad"].as_str().unwrap().contains(reason),
        "{said}"
    );
}

#[test]
fn samples_that_come_to_the_same_setting_are_counted_once_and_said() {
    let bench = Bench::new();
    let study = "
study: samples
environments: { env: { pendulum: {} } }
agents: { sac: { soft_actor_critic: { width: 8, learning_starts: 50, batch_size: 16 } } }
protocol: { train_evaluate: { steps: 100, evaluate_every: 100, episodes: 1, final_episodes: 1, environments: 2, trace_episodes: 0 } }
seeds: 1
sweep: { sac.width: { log_uniform: { low: 8, high: 9, samples: 6 } } }
";
    bench.write("samples.yaml", study);
    const SAID: &str = "6 samples, 2 different settings";
    let plan = bench.run(&["plan", "samples.yaml"]);
    assert!(
        plan.out.starts_with(&format!("samples: 2 trials\n  {SAID}\n")),
        "{}",
        plan.out
    );
    assert!(plan.err.contains(SAID), "{}", plan.err);
    assert!(!plan.out.contains("0, 0"), "{}", plan.out);
    let checked = bench.run(&["check", "samples.yaml"]);
    assert!(
        checked.out.contains("ok, 2 trials") && checked.err.contains(SAID),
        "{}",
        checked.out
    );
    let computed = bench.run(&["run", "samples.yaml", "-j", "1", "--verbose"]);
    assert!(
        computed.err.contains("running 2 trials") && computed.err.contains(SAID),
        "{}",
        computed.err
    );
    assert!(
        computed
            .out
            .replace('\n', " ")
            .contains(&format!("Sweep: {SAID}.")),
        "{}",
        computed.out
    );
    let status = bench.ok(&["status", "samples.yaml"]);
    assert!(
        status.starts_with(&format!("samples: 2 trials\n  {SAID}\n")),
        "{status}"
    );
    let report = fs::read_to_string(bench.path("results/samples/report.md")).unwrap();
    assert!(report.contains(SAID), "{report}");
}
