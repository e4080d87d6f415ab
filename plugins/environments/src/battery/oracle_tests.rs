//! The environment compared with trajectories of other programs (`tests/fixtures/battery`).

use super::*;
use std::{collections::BTreeMap, io::Write, path::PathBuf};

/// Largest allowed deviation of a voltage, V, and of a state relative to its value.
const VOLTAGE_TOLERANCE: f64 = 1e-6;
const STATE_TOLERANCE: f64 = 1e-9;

/// A CSV file by columns; empty cells are NaN.
struct Frame {
    name: String,
    columns: BTreeMap<String, Vec<f64>>,
}

impl Frame {
    fn read(path: &PathBuf) -> Self {
        let mut reader = csv::Reader::from_path(path).unwrap();
        let header = reader.headers().unwrap().clone();
        let mut columns: BTreeMap<String, Vec<f64>> =
            header.iter().map(|name| (name.to_owned(), Vec::new())).collect();
        for record in reader.records() {
            for (name, text) in header.iter().zip(&record.unwrap()) {
                columns
                    .get_mut(name)
                    .unwrap()
                    .push(text.parse().unwrap_or(f64::NAN));
            }
        }
        Self {
            name: path.file_stem().unwrap().to_string_lossy().into_owned(),
            columns,
        }
    }

    fn at(&self, column: &str, row: usize) -> f64 {
        self.columns[column][row]
    }

    fn len(&self) -> usize {
        self.columns.values().next().unwrap().len()
    }

    fn row(&self, names: &[String], row: usize) -> Vec<f64> {
        names.iter().map(|name| self.at(name, row)).collect()
    }

    /// The eight states of a row.
    fn state(&self, row: usize) -> [f64; 8] {
        State::NAMES.map(|name| self.at(name, row))
    }
}

fn frames(belongs: fn(&str) -> bool) -> Vec<Frame> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures/battery");
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    paths.sort();
    paths.retain(|path| belongs(&path.file_stem().unwrap().to_string_lossy()));
    assert!(!paths.is_empty(), "no reference files");
    paths.iter().map(Frame::read).collect()
}

fn assert_close(ours: f64, theirs: f64, relative: f64, what: &str) {
    let limit = relative * theirs.abs().max(1e-9);
    assert!(
        (ours - theirs).abs() <= limit,
        "{what}: {ours} here, {theirs} there"
    );
}

/// Names of trace channels and their values.
fn traced(battery: &Battery) -> BTreeMap<String, f64> {
    battery
        .trace_channels()
        .into_iter()
        .map(|channel| channel.name)
        .zip(battery.trace())
        .collect()
}

fn assert_state(battery: &Battery, frame: &Frame, row: usize) {
    let (trace, place) = (traced(battery), format!("{} row {row}", frame.name));
    for (name, theirs) in State::NAMES.iter().zip(frame.state(row)) {
        assert_close(
            trace[&format!("{name}_1")],
            theirs,
            STATE_TOLERANCE,
            &format!("{place} {name}"),
        );
    }
    let difference = (trace["voltage_1"] - frame.at("v_V", row)).abs();
    assert!(
        difference < VOLTAGE_TOLERANCE,
        "{place}: voltage differs by {difference}"
    );
}

/// Writes a load file with one row per `(time, load)`.
fn load_file(column: &str, rows: impl Iterator<Item = (f64, f64)>) -> (tempfile::NamedTempFile, Load) {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    writeln!(file, "t_s,{column}").unwrap();
    rows.for_each(|(time_s, load)| writeln!(file, "{time_s},{load}").unwrap());
    let load = Load::File(contract::DataFile::new(file.path()));
    (file, load)
}

fn one_cell(name: &str) -> CellParameters {
    let Some(aged) = name.strip_prefix("aged_q") else {
        return CellParameters::FRESH;
    };
    let numbers: Vec<f64> = aged
        .split('_')
        .take(3)
        .map(|part| part.trim_matches(|c| "RoD".contains(c)).parse().unwrap())
        .collect();
    CellParameters {
        q_mobile_c: numbers[0],
        r_ohm: numbers[1],
        t_diffusion: numbers[2],
    }
}

fn start_of(frame: &Frame) -> Start {
    match frame.name.strip_prefix("rested_soc") {
        Some(rest) => Start::StateOfCharge(vec![rest.split('_').next().unwrap().parse().unwrap()]),
        None if frame.name.starts_with("start_at") => Start::States(vec![frame.state(0)]),
        None => Start::Full,
    }
}

/// Steps one cell every second and compares it with each row; the last row must be the one that terminates.
fn follow(mut battery: Battery, frame: &Frame) {
    let mut rng = contract::random::stream(&[]);
    battery.reset(&mut rng).unwrap();
    assert_state(&battery, frame, 0);
    let mut time_s = 0.0;
    for row in 1..frame.len() {
        while time_s < frame.at("t_s", row) {
            let step = battery.step(&[vec![1.0]], &mut rng).unwrap();
            time_s += 1.0;
            let last = row + 1 == frame.len() && time_s == frame.at("t_s", row);
            assert_eq!(
                step.end,
                last.then_some(End::Terminated),
                "{} at {time_s} s",
                frame.name
            );
        }
        assert_state(&battery, frame, row);
    }
}

#[test]
fn single_cells_follow_the_reference_program() {
    let prefixes = |name: &str| {
        ["const_", "step_", "random_", "aged_", "start_at", "rested_"]
            .iter()
            .any(|prefix| name.starts_with(prefix))
    };
    for frame in frames(prefixes) {
        let is_current = frame.name.ends_with('A') || frame.name.ends_with("current");
        let rows = (0..frame.len()).map(|row| (frame.at("t_s", row), frame.at("load", row)));
        let (_file, load) = load_file(if is_current { "current_a" } else { "power_w" }, rows);
        let config = BatteryConfig {
            cells: Cells::Each(vec![one_cell(&frame.name)]),
            thermal: true,
            decision_interval_s: 1.0,
            load,
            start: start_of(&frame),
            ..Default::default()
        };
        follow(Battery::new(config).unwrap(), &frame);
    }
}

#[test]
fn wearing_cells_follow_the_reference_program() {
    for frame in frames(|name| name.starts_with("eodeol")) {
        let config = BatteryConfig {
            cells: Cells::Count(1),
            thermal: true,
            decision_interval_s: 1.0,
            load: Load::ConstantCurrent { current_a: 2.0 },
            start: Start::Full,
            ageing: Some(AgeingRates::default()),
            ..Default::default()
        };
        let mut battery = Battery::new(config.clone()).unwrap();
        follow(Battery::new(config).unwrap(), &frame);
        let mut rng = contract::random::stream(&[]);
        battery.reset(&mut rng).unwrap();
        while battery.step(&[vec![1.0]], &mut rng).unwrap().end.is_none() {}
        let (trace, last) = (traced(&battery), frame.len() - 1);
        for (ours, theirs) in [
            ("q_mobile_c_1", "qMobile"),
            ("r_ohm_1", "Ro"),
            ("t_diffusion_1", "tDiffusion"),
        ] {
            assert_close(trace[ours], frame.at(theirs, last), STATE_TOLERANCE, ours);
        }
    }
}

#[test]
fn rested_voltages_follow_the_reference_program() {
    for frame in frames(|name| name == "ocv_table") {
        for row in 0..frame.len() {
            let start = Start::StateOfCharge(vec![frame.at("soc", row)]);
            let mut battery = Battery::new(BatteryConfig {
                cells: Cells::Count(1),
                start,
                ..Default::default()
            })
            .unwrap();
            battery.reset(&mut contract::random::stream(&[])).unwrap();
            assert!(
                (battery.cells()[0].voltage_v() - frame.at("v_rest_V", row)).abs() < VOLTAGE_TOLERANCE,
                "row {row}"
            );
        }
    }
}

#[test]
fn profile_starts_follow_the_reference_program() {
    for frame in frames(|name| name == "isothermal_8W_profile") {
        for row in (0..frame.len()).step_by(frame.len().div_ceil(200)) {
            let start = Start::ProfileIndex(vec![frame.at("t_s", row) as usize]);
            let mut battery = Battery::new(BatteryConfig {
                cells: Cells::Count(1),
                start,
                ..Default::default()
            })
            .unwrap();
            let observation = battery.reset(&mut contract::random::stream(&[])).unwrap();
            assert_state(&battery, &frame, row);
            assert_close(
                observation[0][1],
                8.0 / frame.at("v_V", row),
                1e-9,
                "initial current",
            );
        }
    }
}

/// Cells and start indices of a reference episode.
fn pack_of(name: &str) -> (Cells, Vec<usize>) {
    if name.starts_with("env8") {
        return (Cells::Count(8), vec![520, 700, 900, 1100, 1300, 1500, 1700, 1950]);
    }
    if name.contains("secondlife") {
        return (Cells::Named(NamedPack::SecondLife), vec![600, 800, 1000, 700]);
    }
    (Cells::Count(4), vec![600, 1000, 1500, 1900])
}

#[test]
fn packs_follow_the_reference_episodes() {
    for frame in frames(|name| name.starts_with("env")) {
        let (cells, indices) = pack_of(&frame.name);
        let count = indices.len();
        let rows = (1..frame.len()).map(|row| (10.0 * (row - 1) as f64, frame.at("P_total_W", row)));
        let (_file, load) = load_file("power_w", rows);
        let config = BatteryConfig {
            cells,
            load,
            start: Start::ProfileIndex(indices),
            ..Default::default()
        };
        follow_pack(Battery::new(config).unwrap(), &frame, count);
    }
}

fn follow_pack(mut battery: Battery, frame: &Frame, count: usize) {
    let names = |prefix: &str, suffix: &str| -> Vec<String> {
        (1..=count).map(|n| format!("{prefix}{n}{suffix}")).collect()
    };
    let mut rng = contract::random::stream(&[]);
    let start = battery.reset(&mut rng).unwrap();
    assert_voltages(&start[0], &frame.row(&names("V", ""), 0), &frame.name);
    for row in 1..frame.len() {
        let weights = frame.row(&names("w", ""), row);
        let step = battery.step(&[weights], &mut rng).unwrap();
        let place = format!("{} decision {row}", frame.name);
        assert_voltages(&step.observations[0], &frame.row(&names("V", ""), row), &place);
        for (ours, theirs) in step.observations[0][count..]
            .iter()
            .zip(frame.row(&names("I", "_last_s"), row))
        {
            assert_close(*ours, theirs, STATE_TOLERANCE, &place);
        }
        assert_eq!(traced(&battery)["power_w"], frame.at("P_total_W", row), "{place}");
        assert_eq!(step.end.is_some(), frame.at("done", row) == 1.0, "{place}");
        assert_eq!(step.end.is_some(), row + 1 == frame.len(), "{place}");
    }
}

fn assert_voltages(ours: &[f64], theirs: &[f64], place: &str) {
    for (ours, theirs) in ours.iter().zip(theirs) {
        assert!(
            (ours - theirs).abs() < VOLTAGE_TOLERANCE,
            "{place}: {ours} {theirs}"
        );
    }
}
