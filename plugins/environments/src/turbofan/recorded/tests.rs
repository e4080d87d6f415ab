use super::*;
use crate::turbofan::{
    EngineName, Model, SensorModel,
    calibration::{CalibrationConfig, TurbofanCalibration},
    samples::{self, SamplesConfig},
};
use contract::{Environment as _, random::stream};
use rand::Rng as _;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

const SEEN: [&str; 5] = ["n2_rpm", "t24_k", "t48_k", "p30_pa", "fuel_flow_kg_s"];

/// Three units of `hbtf` in the columns of N-CMAPSS, the same in each format.
fn fixture(extension: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures/turbofan");
    folder.join("recorded").with_extension(extension)
}

fn given(file: &Path) -> RecordedFlights {
    serde_json::from_value(json!({ "file": file })).unwrap()
}

fn read(recorded: &RecordedFlights) -> Result<Recording, Error> {
    read_within(recorded, [-0.03, 0.01])
}

fn read_within(recorded: &RecordedFlights, theta_range: [f64; 2]) -> Result<Recording, Error> {
    let asked = RecordingRequest {
        sensors: &SEEN.map(String::from),
        calibrated: &[HealthParameter::HptEfficiency],
        theta_range,
    };
    Recording::read(recorded, &asked)
}

fn calibration(recorded: &Value) -> Result<TurbofanCalibration, Error> {
    let config: CalibrationConfig =
        serde_json::from_value(json!({ "recorded": recorded, "sensors": SEEN, "trajectory": "units" }))
            .unwrap();
    TurbofanCalibration::new(config)
}

#[test]
fn every_format_says_the_same() {
    let text = read(&given(&fixture("csv"))).unwrap();
    let numbers = |it: &Recording| it.units.iter().map(|unit| unit.number).collect::<Vec<_>>();
    let lengths = |it: &Recording| (0..it.n_units()).map(|unit| it.length(unit)).collect::<Vec<_>>();
    assert_eq!(
        (numbers(&text), lengths(&text)),
        (vec![2, 5, 11], vec![12, 12, 6])
    );
    let formats: &[&str] = if cfg!(feature = "hdf5") {
        &["parquet", "h5"]
    } else {
        &["parquet"]
    };
    for format in formats {
        let other = read(&given(&fixture(format))).unwrap();
        assert_eq!(
            (numbers(&other), lengths(&other)),
            (numbers(&text), lengths(&text))
        );
        for (mine, yours) in text.units.iter().zip(&other.units) {
            assert_eq!(mine.samples, yours.samples, "{format}");
        }
        assert_eq!(text.extremes, other.extremes, "{format}");
    }
}

/// Whatever the damage to the bytes of a recording: it is read or refused, and never ends its reader.
#[test]
fn a_damaged_recording_is_read_or_refused() {
    contract::panics::print_no_caught_ones();
    let dir = tempfile::tempdir().unwrap();
    for format in ["csv", "parquet", "h5"] {
        let whole = std::fs::read(fixture(format)).unwrap();
        let path = dir.path().join("damaged").with_extension(format);
        let (mut random, mut refused) = (stream(&["damage", format]), 0);
        for _ in 0..200 {
            let mut bytes = whole.clone();
            // A file's description of itself stands at its ends, where damage has the greatest effect.
            let ends = bytes.len().min(600);
            let near = random.random_range(0..ends);
            let place = match random.random_range(0..3) {
                0 => near,
                1 => bytes.len() - 1 - near,
                _ => random.random_range(0..bytes.len()),
            };
            match random.random_range(0..4) {
                0 => bytes.truncate(place),
                1 => bytes[place] ^= 1 << random.random_range(0..8),
                2 => bytes.insert(place, random.random()),
                _ => bytes[place] = random.random(),
            }
            std::fs::write(&path, bytes).unwrap();
            refused += usize::from(read(&given(&path)).is_err());
        }
        assert!(refused > 20, "{format}: {refused} of 200");
    }
}

#[test]
fn units_are_those_of_the_engine_that_was_recorded() {
    let recording = read(&given(&fixture("csv"))).unwrap();
    let sensors = SEEN.map(String::from);
    let calibrated = [HealthParameter::HptEfficiency];
    let mut engine = SensorModel::new(EngineName::Hbtf, &Model::Engine, &calibrated, &sensors).unwrap();
    for unit in 0..3 {
        for at in 0..recording.length(unit) {
            let sample = recording.sample(unit, at);
            // The day of the fixture is as many kelvins from a standard one as the unit's number says.
            let delta_t_k = f64::from(recording.number(unit)) - 4.0;
            assert!(
                (sample.condition.delta_t_k - delta_t_k).abs() < 1e-6,
                "{sample:?}"
            );
            let found = engine.read(&sample.condition, &sample.theta).unwrap();
            let recorded = sample.read.as_ref().unwrap();
            let is_close = |(x, y): (&f64, &f64)| (x / y - 1.0).abs() < 1e-7;
            assert!(found.iter().zip(recorded).all(is_close), "{found:?} {recorded:?}");
        }
    }
}

#[test]
fn flights_are_thinned_and_units_chosen_and_ranges_stay() {
    let whole = read(&given(&fixture("csv"))).unwrap();
    let chosen = RecordedFlights {
        every: 4,
        units: vec![11, 2],
        ..given(&fixture("csv"))
    };
    let thin = read(&chosen).unwrap();
    assert_eq!((thin.number(0), thin.number(1)), (2, 11));
    // The first and the fifth of each flight of six.
    let kept: Vec<&Sample> = [0, 4, 6, 10].map(|at| whole.sample(0, at)).to_vec();
    assert_eq!(
        (0..thin.length(0))
            .map(|at| thin.sample(0, at))
            .collect::<Vec<_>>(),
        kept
    );
    assert_eq!(thin.ranges(false), whole.ranges(false));
}

#[test]
fn the_true_health_in_the_engine_gives_what_was_recorded() {
    let mut problem = calibration(&json!({ "file": fixture("csv"), "units": [5] })).unwrap();
    let mut rng = stream(&["recorded"]);
    problem.reset_to(0, &mut rng).unwrap();
    let mut decisions = 0;
    loop {
        let theta = problem.state()[0];
        // Actions of -1 and 1 mean a health of -0.03 and 0.01.
        let step = problem.step(&[vec![(theta + 0.01) / 0.02]], &mut rng).unwrap();
        decisions += 1;
        assert!(
            step.metric("theta_rmse").unwrap() < 1e-12 && step.metric("output_rmse").unwrap() < 1e-6,
            "{step:?}"
        );
        if step.end.is_some() {
            break;
        }
    }
    assert_eq!(decisions, 12);
    // A snapshot restores the same sample.
    problem.reset_to(0, &mut rng).unwrap();
    problem.step(&[vec![0.0]], &mut rng).unwrap();
    let (snapshot, state) = (problem.snapshot(), problem.trace());
    problem.reset_to(0, &mut rng).unwrap();
    problem.restore(&snapshot).unwrap();
    assert_eq!(format!("{:?}", problem.trace()), format!("{state:?}"));
}

#[test]
fn examples_are_recorded_samples_with_their_health() {
    let config: SamplesConfig = serde_json::from_value(
        json!({ "recorded": { "file": fixture("parquet") }, "sensors": SEEN, "corrected": false }),
    )
    .unwrap();
    let mut examples = samples::build(config).unwrap();
    let recording = read(&given(&fixture("csv"))).unwrap();
    let mut rng = stream(&["examples"]);
    let mut met = Vec::new();
    for _ in 0..200 {
        let seen = examples.reset(&mut rng).unwrap().remove(0);
        let known = (0..3).flat_map(|unit| (0..recording.length(unit)).map(move |at| (unit, at)));
        let place = known.into_iter().find(|(unit, at)| {
            let sample = recording.sample(*unit, *at);
            seen == [&sample.condition.to_array()[..], &sample.theta].concat()
                && sample.read.as_ref() == Some(&examples.state())
        });
        met.push(place.expect("a recorded sample"));
    }
    met.sort_unstable();
    met.dedup();
    assert_eq!(met.len(), 30);
}

/// The CSV fixture with one piece of text replaced.
fn altered(from: &str, to: &str) -> (tempfile::TempDir, RecordedFlights) {
    let text = std::fs::read_to_string(fixture("csv")).unwrap();
    assert!(text.contains(from));
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("recorded.csv");
    std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
    let recorded = given(&path);
    (dir, recorded)
}

#[test]
fn mistakes_in_a_file_are_named_with_their_line() {
    for (from, to, expected) in [
        (
            ",T40,",
            ",T4O,",
            "line 1, column `T40`: is missing; there are unit, cycle",
        ),
        (
            "\n2.0,1.0,1.0,1.0,10498",
            "\n2.0,1.0,1.0,1.0,NaN10498",
            "line 2, column `alt`: `NaN10498",
        ),
        (
            "\n2.0,1.0,1.0,1.0,10498.687664041994,0.45",
            "\n2.0,1.0,1.0,1.0,10498.687664041994,nan",
            "column `Mach`: `nan` is no number",
        ),
        (
            "\n2.0,1.0,1.0,1.0,10498",
            "\n2.0,1.0,1.0,1.0,90498",
            "line 2, column `alt`: the sample lies outside the envelope",
        ),
        (
            "\n2.0,1.0,1.0,1.0,10498",
            "\n2.5,1.0,1.0,1.0,10498",
            "column `unit`: 2.5 is no number of one",
        ),
        (
            "\n2.0,1.0,1.0,1.0,10498",
            "\n5.0,1.0,1.0,1.0,10498",
            "column `unit`: unit 5 comes again after others",
        ),
        (
            "\n2.0,1.0,1.0,1.0,10498",
            "\n2.0,7.0,1.0,1.0,10498",
            "column `cycle`: cycle 1 of unit 2 comes after cycle 7",
        ),
    ] {
        let (_dir, recorded) = altered(from, to);
        let message = read(&recorded).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
    let message = read_within(&given(&fixture("csv")), [-0.004, 0.01])
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("column `HPT_eff_mod`: -0.005 is not within `theta_range`"),
        "{message}"
    );
}

#[test]
fn sensors_and_units_that_are_not_recorded_are_refused() {
    let refused = |config: Value| {
        let config: CalibrationConfig = serde_json::from_value(config).unwrap();
        TurbofanCalibration::new(config).unwrap_err().to_string()
    };
    let file = fixture("csv");
    let message = refused(json!({ "recorded": { "file": file, "units": [3] }, "sensors": SEEN }));
    assert!(
        message.contains("there is no unit 3; there are 2, 5, 11"),
        "{message}"
    );
    let message = refused(json!({ "recorded": { "file": file } }));
    assert!(
        message.contains("`t21_k` is not recorded; there are n1_rpm"),
        "{message}"
    );
    let message = refused(json!({ "recorded": { "file": file }, "sensors": SEEN, "fleet": { "units": 3 } }));
    assert!(message.contains("there is no fleet"), "{message}");
}

#[cfg(feature = "hdf5")]
#[test]
fn a_torn_hdf5_file_is_damaged() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("torn.h5");
    let whole = std::fs::read(fixture("h5")).unwrap();
    std::fs::write(&path, &whole[..600]).unwrap();
    let error = read(&given(&path)).unwrap_err();
    assert!(matches!(error, Error::Damaged { .. }), "{error}");
}
