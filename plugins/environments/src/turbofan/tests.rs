//! The engines compared with other programs, their balances over the whole envelope, and their exact
//! derivatives.

use super::atmosphere::Air;
use super::cycle::{Engine, Health, N, Point, Wear};
use super::engine::EngineName;
use super::flight::FlightPoint;
use super::solver::{HeldQuantity, Operation};
use super::*;
use contract::random::stream;
use rand::Rng as _;
use std::{collections::BTreeMap, path::PathBuf};

type Row = BTreeMap<String, String>;

fn fixture(name: &str) -> Vec<Row> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures/turbofan");
    let mut reader = csv::Reader::from_path(folder.join(name)).unwrap();
    reader.deserialize().map(Result::unwrap).collect()
}

fn number(row: &Row, column: &str) -> f64 {
    row[column].parse().unwrap()
}

fn solved(engine: &Engine, operation: &Operation) -> (Point<f64>, [f64; N]) {
    let mut unknowns = engine.unknowns;
    let point = engine.solve(operation, &mut unknowns).unwrap();
    (point, unknowns)
}

#[test]
fn the_atmosphere_is_the_standard_one() {
    for row in fixture("atmosphere.csv") {
        let air = Air::at(number(&row, "altitude_m"), 0.0, 0.0);
        let (temperature, pressure) = (number(&row, "temperature_k"), number(&row, "pressure_pa"));
        assert!(
            (air.total_temperature - temperature).abs() < 2e-3,
            "{row:?} {air:?}"
        );
        assert!((air.pressure / pressure - 1.0).abs() < 5e-5, "{row:?} {air:?}");
    }
}

/// The outputs that are compared with pyCycle: those of `OUTPUTS` in the fixture.
const COMPARED: [&str; 15] = [
    "n1_rpm",
    "n2_rpm",
    "fuel_flow_kg_s",
    "t24_k",
    "p24_pa",
    "t30_k",
    "p30_pa",
    "t48_k",
    "p45_pa",
    "t50_k",
    "p50_pa",
    "p21_pa",
    "bypass_ratio",
    "thrust_n",
    "mass_flow_kg_s",
];

/// This engine's outputs for a row of the fixture, by name.
fn ours(engine: &Turbofan, row: &Row) -> BTreeMap<&'static str, f64> {
    let wear = |part: &str| Wear {
        efficiency: number(row, &format!("{part}_efficiency")),
        flow: number(row, &format!("{part}_flow")),
    };
    let held = if row["held"] == "thrust_n" {
        HeldQuantity::Thrust(number(row, "thrust_n"))
    } else {
        HeldQuantity::TurbineInletTemperature(number(row, "t40_k"))
    };
    let operation = Operation {
        air: Air::at(number(row, "altitude_m"), number(row, "mach"), 0.0),
        health: Health {
            hpt: wear("hpt"),
            lpt: wear("lpt"),
            ..Health::default()
        },
        held,
        speeds: None,
    };
    let (point, unknowns) = solved(&engine.engine, &operation);
    let outputs = outputs(&engine.engine, &point, &unknowns);
    OUTPUTS.iter().map(|(name, _)| *name).zip(outputs).collect()
}

fn hbtf() -> Turbofan {
    Turbofan::new(TurbofanConfig::default()).unwrap()
}

fn is_healthy(row: &Row) -> bool {
    ["hpt_efficiency", "hpt_flow", "lpt_efficiency", "lpt_flow"]
        .iter()
        .all(|column| number(row, column) == 0.0)
}

#[test]
fn the_high_bypass_engine_is_that_of_pycycle() {
    let engine = hbtf();
    for (index, row) in fixture("pycycle_hbtf.csv").iter().enumerate() {
        if !is_healthy(row) {
            continue;
        }
        let ours = ours(&engine, row);
        // The first row is the design point.
        let tolerance = if index == 0 { 1e-3 } else { 1.2e-2 };
        for column in COMPARED {
            let deviation = ours[column] / number(row, column) - 1.0;
            assert!(
                deviation.abs() < tolerance,
                "{column}: {:.2} % in {row:?}",
                100.0 * deviation
            );
        }
    }
}

#[test]
fn wear_changes_what_it_changes_in_pycycle() {
    let (engine, rows) = (hbtf(), fixture("pycycle_hbtf.csv"));
    let of_healthy = |row: &Row| {
        let alike = |other: &&Row| {
            let same = ["held", "altitude_m", "mach"]
                .iter()
                .all(|column| other[*column] == row[*column]);
            // Part power is 90 % of the engine's own full thrust.
            is_healthy(other) && same && (row["held"] != "thrust_n" || is_ninety_percent(other, &rows))
        };
        rows.iter().find(alike).unwrap()
    };
    let mut compared = 0;
    for row in rows.iter().filter(|row| !is_healthy(row)) {
        let healthy = of_healthy(row);
        let (now, before) = (ours(&engine, row), ours(&engine, healthy));
        for column in COMPARED {
            let theirs = number(row, column) / number(healthy, column) - 1.0;
            if theirs.abs() > 3e-3 {
                let change = now[column] / before[column] - 1.0;
                compared += 1;
                assert!(
                    (change / theirs - 1.0).abs() < 0.3,
                    "{column}: {:.2} % against {:.2} % in {row:?}",
                    100.0 * change,
                    100.0 * theirs
                );
            }
        }
    }
    assert!(compared > 60, "{compared}");
}

fn is_ninety_percent(row: &Row, rows: &[Row]) -> bool {
    (number(row, "thrust_n") / number(&rows[0], "thrust_n") - 0.9).abs() < 1e-3
}

/// Rows of NASA's AGTF30 at cruise and at take-off: the engine agrees with the published values within these
/// fractions.
#[test]
#[expect(clippy::print_stdout, reason = "what differs is shown, not hidden")]
fn the_geared_engine_is_near_that_of_nasa() {
    const POUND: f64 = 0.453_592_37;
    const PSI: f64 = 6894.757;
    let config = TurbofanConfig {
        engine: EngineName::Agtf30,
        ..TurbofanConfig::default()
    };
    let engine = Turbofan::new(config).unwrap();
    let cruise = [
        ("mass_flow_kg_s", 815.48 * POUND),
        ("n1_rpm", 6772.0),
        ("n2_rpm", 20_796.0),
        ("p21_pa", 6.862 * PSI),
        ("p24_pa", 20.14 * PSI),
        ("p30_pa", 270.75 * PSI),
        ("t24_k", 679.6 / 1.8),
        ("t30_k", 1531.3 / 1.8),
        ("t48_k", 2237.2 / 1.8),
    ];
    let take_off = [
        ("mass_flow_kg_s", 1723.8 * POUND),
        ("n1_rpm", 6079.0),
        ("n2_rpm", 21_583.0),
        ("p21_pa", 17.17 * PSI),
        ("p24_pa", 42.24 * PSI),
        ("p30_pa", 524.57 * PSI),
        ("t24_k", 758.4 / 1.8),
        ("t30_k", 1631.6 / 1.8),
        ("t48_k", 2258.0 / 1.8),
    ];
    for (air, fuel, published) in [
        (Air::at(10_668.0, 0.8, 0.0), 0.7837 * POUND, cruise),
        (Air::at(0.0, 0.0, 15.0), 1.3896 * POUND, take_off),
    ] {
        let operation = Operation {
            air,
            health: Health::default(),
            held: HeldQuantity::FuelFlow(fuel),
            speeds: None,
        };
        let (point, unknowns) = solved(&engine.engine, &operation);
        let outputs = outputs(&engine.engine, &point, &unknowns);
        for (name, value) in published {
            let place = OUTPUTS.iter().position(|(output, _)| *output == name).unwrap();
            let deviation = outputs[place] / value - 1.0;
            println!("{name}: {:+.2} %", 100.0 * deviation);
            assert!(deviation.abs() < 0.03, "{name}: {:.2} %", 100.0 * deviation);
        }
    }
}

/// C-MAPSS at sea level with full throttle (the first healthy row of its data set FD001) is an engine of the
/// same kind, with a higher pressure ratio and bypass ratio. At its fuel-air ratio this engine differs as
/// shown: it is not fitted to C-MAPSS.
#[test]
#[expect(clippy::print_stdout, reason = "what differs is shown, not hidden")]
fn how_far_the_first_engine_is_from_c_mapss() {
    let engine = Turbofan::new(TurbofanConfig::default()).unwrap();
    let at = |held: f64| {
        let operation = Operation {
            air: Air::at(0.0, 0.0, 0.0),
            health: Health::default(),
            held: HeldQuantity::TurbineInletTemperature(held),
            speeds: None,
        };
        let (point, unknowns) = solved(&engine.engine, &operation);
        let outputs = outputs(&engine.engine, &point, &unknowns);
        move |name: &str| outputs[OUTPUTS.iter().position(|(output, _)| *output == name).unwrap()]
    };
    let (mut cold, mut hot) = (1300.0, 1900.0);
    while hot - cold > 1e-6 {
        let middle = f64::midpoint(cold, hot);
        if at(middle)("fuel_air_ratio") < 0.03 {
            cold = middle;
        } else {
            hot = middle;
        }
    }
    let found = at(hot);
    let parts = [
        ("t24_k", found("t24_k"), 642.0 / 1.8, 0.2),
        ("t30_k", found("t30_k"), 1589.7 / 1.8, 0.1),
        ("p15 / p2", found("p15_pa") / found("p2_pa"), 21.61 / 14.62, 0.25),
        ("p30 / p2", found("p30_pa") / found("p2_pa"), 554.36 / 14.62, 0.25),
        ("bypass ratio", found("bypass_ratio"), 8.4195, 0.45),
        ("t50_k", found("t50_k"), 1400.6 / 1.8, 0.25),
    ];
    for (name, found, published, most) in parts {
        let deviation = found / published - 1.0;
        println!(
            "{name}: {found:.4} against {published:.4}, {:+.1} %",
            100.0 * deviation
        );
        assert!(deviation.abs() < most, "{name}: {:.1} %", 100.0 * deviation);
    }
}

/// An operation drawn from the envelope and the box of health. The throttle is a fraction of the design point's
/// ratio of turbine inlet and ambient temperature, as long as that is not hotter than the turbine may be.
fn drawn(engine: &Engine, worst: f64, rng: &mut Rng) -> Operation {
    let mut between = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    let mach = between(0.0, 0.9);
    let delta_t_k = between(-35.0, 35.0);
    let altitude_m = between(0.0, flight::ceiling_m(mach));
    let throttle = between(0.72, 1.06);
    let mut wear = || Wear {
        efficiency: between(-worst, 0.4 * worst),
        flow: between(-worst, 0.4 * worst),
    };
    let health = Health {
        fan: wear(),
        lpc: wear(),
        hpc: wear(),
        hpt: wear(),
        lpt: wear(),
    };
    let design = &engine.design;
    let cold = Air::at(design.altitude_m, design.mach, 0.0).total_temperature;
    let warmer = Air::at(altitude_m, mach, delta_t_k).total_temperature / cold;
    let hot = design.turbine_inlet_temperature_k * (throttle * warmer).min(1.06);
    let point = FlightPoint {
        altitude_m,
        mach,
        delta_t_k,
        held: HeldQuantity::TurbineInletTemperature(hot),
    };
    assert_eq!(point.outside(), None);
    Operation::at(&point, health)
}

/// All components worn by up to 5 %: nearly every operation has a point. With up to 10 %, which is the whole
/// box of actions and more than any component of N-CMAPSS loses but the fan, some engines cannot sustain
/// themselves at low power.
#[test]
#[expect(clippy::print_stdout, reason = "what does not converge is shown, not hidden")]
fn the_whole_envelope_converges_and_balances() {
    for (name, worst, most_failures) in [
        (EngineName::Hbtf, 0.05, 0),
        (EngineName::Agtf30, 0.05, 10),
        (EngineName::Hbtf, LARGEST_WEAR, 10),
        (EngineName::Agtf30, LARGEST_WEAR, 100),
    ] {
        let engine = Engine::of(name.design());
        let mut rng = stream(&["envelope"]);
        let mut failures = Vec::new();
        for _ in 0..10_000 {
            let operation = drawn(&engine, worst, &mut rng);
            let mut unknowns = engine.unknowns;
            match engine.solve(&operation, &mut unknowns) {
                Ok(point) => balanced(&engine, &operation, &point),
                Err(failed) => failures.push((operation, failed)),
            }
        }
        let count = failures.len();
        println!("{name:?}, worn by up to {worst}: {count} of 10000 operations have no point");
        assert!(
            count <= most_failures,
            "{name:?}: {count} failures, the first {:?}",
            failures[0]
        );
    }
}

/// Mass, energy and shafts of a point, from the flows across the boundary of the engine: air and fuel enter;
/// the flows of the nozzles and bleeds and the power of the shafts leave.
fn balanced(engine: &Engine, operation: &Operation, point: &Point<f64>) {
    let (design, bleeds) = (&engine.design, &engine.design.bleeds);
    let (inlet, fan, lpc, hpc) = (&point.inlet, &point.fan, &point.lpc, &point.hpc);
    let hpc_inlet = hpc.mass_flow / (1.0 - bleeds.inside());
    let around = fan.mass_flow * point.bypass_ratio / (1.0 + point.bypass_ratio);
    let out = [
        (point.lpt.mass_flow, point.lpt.enthalpy),
        (point.bypass.mass_flow, point.bypass.enthalpy),
        (around * bleeds.bypass, fan.enthalpy),
        (lpc.mass_flow - hpc_inlet, lpc.enthalpy),
        (
            hpc_inlet * bleeds.hpc_to_customer,
            (lpc.enthalpy + hpc.enthalpy) / 2.0,
        ),
    ];
    let mass = inlet.mass_flow + point.fuel_flow - out.iter().map(|(flow, _)| flow).sum::<f64>();
    assert!(
        mass.abs() < 1e-9 * inlet.mass_flow,
        "{operation:?}: {mass:e} kg/s are lost"
    );
    let lp_work = inlet.work_to(fan) + lpc.mass_flow * (lpc.enthalpy - fan.enthalpy);
    let lp_power = (lp_work + point.surplus_power[0]) / design.lp_mechanical_efficiency;
    let friction = lp_power * (1.0 - design.lp_mechanical_efficiency);
    let taken = design.power_offtake + friction + point.surplus_power.iter().sum::<f64>();
    let heat = point.fuel_flow * design.fuel_heat;
    let energy = inlet.mass_flow * inlet.enthalpy + heat
        - taken
        - out.iter().map(|(flow, enthalpy)| flow * enthalpy).sum::<f64>();
    assert!(
        energy.abs() < 1e-7 * heat,
        "{operation:?}: {energy:e} W of {heat:e} are lost"
    );
    for (shaft, surplus) in point.surplus_power.iter().enumerate() {
        assert!(
            surplus.abs() < 1e-6 * lp_power,
            "{operation:?}: shaft {shaft} keeps {surplus:e} W"
        );
    }
    assert!(
        point.burner.temperature > point.hpt.temperature && point.hpt.temperature > point.lpt.temperature
    );
}

#[test]
fn derivatives_are_those_of_finite_differences() {
    for name in [EngineName::Hbtf, EngineName::Agtf30] {
        let engine = Engine::of(name.design());
        let mut rng = stream(&["derivatives"]);
        for _ in 0..20 {
            let operation = drawn(&engine, 0.05, &mut rng);
            let unknowns = solved(&engine, &operation).1;
            let (_, jacobian) = engine.linearised(&unknowns, &operation);
            for column in 0..N {
                let step = 1e-5 * unknowns[column].abs().max(0.1);
                let at = |by: f64| {
                    let mut moved = unknowns;
                    moved[column] += by;
                    engine.linearised(&moved, &operation).0
                };
                let difference = (at(step) - at(-step)) / (2.0 * step);
                for row in 0..N {
                    let (exact, near) = (jacobian[(row, column)], difference[row]);
                    let scale = exact.abs().max(1.0);
                    assert!(
                        (exact - near).abs() < 1e-4 * scale,
                        "{row}, {column}: {exact} {near}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_transient_settles_at_the_steady_point() {
    for name in [EngineName::Hbtf, EngineName::Agtf30] {
        let engine = Engine::of(name.design());
        let at = |fuel: f64| Operation {
            air: Air::at(8000.0, 0.7, 0.0),
            health: Health::default(),
            held: HeldQuantity::FuelFlow(fuel),
            speeds: None,
        };
        let fuel = engine.unknowns[8] * 10.0;
        let (slow, fast) = (at(0.9 * fuel), at(fuel));
        let mut unknowns = solved(&engine, &slow).1;
        let first = engine
            .accelerate(&slow, &fast, &mut unknowns, (0.05, 0.015))
            .unwrap();
        assert!(
            first.surplus_power.iter().all(|power| *power > 0.0),
            "more fuel accelerates"
        );
        engine
            .accelerate(&fast, &fast, &mut unknowns, (60.0, 0.02))
            .unwrap();
        for (here, there) in unknowns.iter().zip(solved(&engine, &fast).1) {
            assert!((here - there).abs() < 1e-4, "{name:?}: {here} {there}");
        }
    }
}

fn flown(config: serde_json::Value, theta: &[f64]) -> Result<Turbofan, String> {
    let config: TurbofanConfig = serde_json::from_value(config).unwrap();
    let mut engine = Turbofan::new(config).map_err(|error| error.to_string())?;
    let mut rng = stream(&["flown"]);
    engine.reset(&mut rng).map_err(|error| error.to_string())?;
    let step = engine.step(&[theta.to_vec()], &mut rng);
    step.map(|_| engine).map_err(|error| error.to_string())
}

#[test]
fn an_impossible_flight_is_refused_with_its_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("points.csv");
    let refused = |text: &str| {
        std::fs::write(&path, text).unwrap();
        let config = serde_json::json!({ "calibrated": ["hpt_efficiency"], "flight": { "file": path } });
        let error = flown(config, &[0.0]).unwrap_err();
        error.replace(&format!("{}/", folder.path().display()), "")
    };
    for (text, message) in [
        (
            "altitude_m,mach,thrust_n\n1,0.2,3\n",
            "`points.csv`, line 1: column `delta_t_k` is missing; there are altitude_m, mach, thrust_n",
        ),
        (
            "altitude_m,mach,delta_t_k\n1,0.2,3\n",
            "`points.csv`, line 1: exactly one of the columns turbine_inlet_temperature_k, thrust_n, \
             fuel_flow_kg_s says what is held; there are 0",
        ),
        (
            "altitude_m,mach,delta_t_k,thrust_n\n1,0.2,0,30000\n1,nan,0,30000\n",
            "`points.csv`, line 3, column `mach`: `nan` is no number",
        ),
        (
            "altitude_m,mach,delta_t_k,thrust_n\n12000,0.1,0,2000\n",
            "`points.csv`, line 2: the point lies outside the envelope: altitude_m 12000 is not from -100 to \
             the ceiling at mach 0.1, 3052",
        ),
        (
            "altitude_m,mach,delta_t_k,thrust_n\n",
            "`points.csv`: there is no point",
        ),
    ] {
        assert_eq!(refused(text), message);
    }
    let hopeless = refused("altitude_m,mach,delta_t_k,thrust_n\n10000,0.8,0,200000\n");
    assert!(
        hopeless.starts_with(
            "turbofan: point 1 (altitude 10000 m, mach 0.8, 0 K from a standard day, thrust_n 200000): the engine \
             finds no operating point; its parts disagree by"
        ),
        "{hopeless}"
    );
}

#[test]
fn actions_outside_their_box_and_contradictions_are_refused() {
    let calibrated = serde_json::json!({ "calibrated": ["hpt_efficiency", "lpt_flow"] });
    let refused = |theta: &[f64]| flown(calibrated.clone(), theta).unwrap_err();
    assert!(
        refused(&[0.0, 0.2]).contains("lpt_flow 0.2 is not from -0.1 to 0.1"),
        "{}",
        refused(&[0.0, 0.2])
    );
    assert!(
        refused(&[f64::NAN, 0.0]).contains("hpt_efficiency NaN"),
        "{}",
        refused(&[f64::NAN, 0.0])
    );
    assert!(
        refused(&[0.0]).contains("1 entries in place of 2"),
        "{}",
        refused(&[0.0])
    );
    for (config, message) in [
        (
            serde_json::json!({ "calibrated": ["fan_flow", "fan_flow"] }),
            "`fan_flow` is calibrated twice",
        ),
        (
            serde_json::json!({ "calibrated": ["fan_flow"], "health": { "fan_flow": 0.01 } }),
            "it is calibrated, so that actions set it",
        ),
        (
            serde_json::json!({ "health": { "fan_flow": 0.3 } }),
            "0.3 is not from -0.1 to 0.1",
        ),
    ] {
        let error = flown(config, &[0.0; 4]).unwrap_err();
        assert!(error.contains(message), "{error}");
    }
}

#[test]
fn drawn_flights_climb_cruise_and_descend_inside_the_envelope() {
    let mut rng = stream(&["flights"]);
    for (class, hours) in [
        (FlightClass::Short, 1.0..3.1),
        (FlightClass::Medium, 3.0..5.1),
        (FlightClass::Long, 5.0..7.1),
    ] {
        let route = Route::new(&Flight::Drawn {
            class,
            interval_s: 60.0,
        })
        .unwrap();
        for _ in 0..20 {
            let points = route.points(6.0, &mut rng);
            assert!(hours.contains(&(points.len() as f64 / 60.0)), "{}", points.len());
            assert!(points.iter().all(|point| point.outside().is_none()));
            let highest = points.iter().map(|point| point.altitude_m).fold(0.0, f64::max);
            assert!(highest > 8500.0 && points[0].altitude_m < 3100.0);
        }
    }
}
