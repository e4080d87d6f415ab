//! Computes ONNX files with `tract` and holds the actions against those that stand beside them.
//!
//! usage: run-with-tract FOLDER, where beside every `<name>.onnx` lies `<name>.json` with `observations` and `actions`
//! (rows), the `scale` of the actions and the `tolerance`, the largest difference in parts of it. All rows are
//! computed at once, and the first three by themselves.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use tract_onnx::prelude::*;

type Rows = Vec<Vec<f64>>;

fn main() -> ExitCode {
    let Some(folder) = std::env::args().nth(1) else {
        eprintln!("usage: run-with-tract FOLDER");
        return ExitCode::from(2);
    };
    let (mut held, mut worst, mut failed) = (0, 0.0f64, false);
    for file in onnx_files(Path::new(&folder)) {
        match compare(&file) {
            Ok(difference) => (held, worst) = (held + 1, worst.max(difference)),
            Err(problem) => {
                eprintln!("{}: {problem}", file.display());
                failed = true;
            }
        }
    }
    println!("{held} policies, largest difference {worst:.2e} of the scale");
    ExitCode::from(u8::from(failed || held == 0))
}

fn onnx_files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    files.retain(|path| path.extension().is_some_and(|extension| extension == "onnx"));
    files.sort();
    files
}

/// The largest difference in parts of the scale; what is wrong where it is too large.
fn compare(file: &Path) -> Result<f64, String> {
    let text = std::fs::read_to_string(file.with_extension("json")).map_err(|error| error.to_string())?;
    let case: serde_json::Value = serde_json::from_str(&text).map_err(|error| error.to_string())?;
    let read = |name: &str| -> Result<Rows, String> {
        serde_json::from_value(case[name].clone()).map_err(|error| format!("`{name}`: {error}"))
    };
    let (observations, actions) = (read("observations")?, read("actions")?);
    let scale = case["scale"].as_f64().ok_or("there is no `scale`")?;
    let tolerance = case["tolerance"].as_f64().ok_or("there is no `tolerance`")?;
    let mut computed = vec![(compute(file, &observations)?, &actions[..])];
    for (row, action) in observations.iter().zip(actions.chunks(1)).take(3) {
        computed.push((compute(file, std::slice::from_ref(row))?, action));
    }
    let pairs = computed
        .iter()
        .flat_map(|(found, expected)| found.iter().zip(*expected));
    let mut worst = 0.0f64;
    for (found, expected) in pairs {
        let difference = found
            .iter()
            .zip(expected)
            .map(|(a, b)| (a - b).abs() / scale)
            .fold(0.0, f64::max);
        // Written so that what is no number fails.
        if found.len() != expected.len() || found.iter().any(|x| x.is_nan()) || difference > tolerance {
            return Err(format!(
                "{found:?} in place of {expected:?}, {difference:.2e} of the scale {scale}"
            ));
        }
        worst = worst.max(difference);
    }
    Ok(worst)
}

fn compute(file: &Path, rows: &[Vec<f64>]) -> Result<Rows, String> {
    run(file, rows).map_err(|error| format!("{error:#}"))
}

fn run(file: &Path, rows: &[Vec<f64>]) -> TractResult<Rows> {
    let shape = [rows.len(), rows[0].len()];
    let model = tract_onnx::onnx().model_for_path(file)?;
    let model = model.with_input_fact(0, f32::fact(shape).into())?;
    let model = model.into_optimized()?.into_runnable()?;
    let entries: Vec<f32> = rows.concat().into_iter().map(|x| x as f32).collect();
    let input = Tensor::from_shape(&shape, &entries)?;
    let output = model.run(tvec!(input.into()))?.remove(0);
    let width = output.shape()[1];
    let plain = output.try_as_plain_ram()?;
    let actions: Vec<f64> = plain.as_slice::<f32>()?.iter().map(|x| f64::from(*x)).collect();
    Ok(actions.chunks(width).map(<[f64]>::to_vec).collect())
}
