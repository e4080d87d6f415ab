//! The output of programs, in every form that is read.

use super::*;

/// The values of a metric in a phase, as `step:value`.
pub(super) fn values(place: &Place, phase: &str, metric: &str) -> Vec<String> {
    let rows = place.rows();
    let names: Vec<&str> = rows[0].split(',').collect();
    let column = |name: &str| names.iter().position(|it| *it == name).unwrap();
    let (of_phase, of_metric, step, value) =
        (column("phase"), column("metric"), column("step"), column("value"));
    let cells = rows[1..].iter().map(|row| row.split(',').collect::<Vec<_>>());
    let wanted = cells.filter(|cells| cells[of_phase] == phase && cells[of_metric] == metric);
    wanted
        .map(|cells| format!("{}:{}", cells[step], cells[value]))
        .collect()
}

fn ran(program: &str, metrics: &str, more: &str) -> Place {
    let place = Place::new(program, metrics, more);
    let answer = place.run(&[]);
    assert_eq!(
        answer.code,
        0,
        "{program}: {}\n{}\n{}",
        answer.out,
        answer.err,
        place.trial()["end"]
    );
    place
}

#[test]
fn lines_of_json_become_a_curve_measurements_and_an_end() {
    let program =
        "for i in 1 2 3 4 5; do echo \"{\\\"t\\\": ${i}50, \\\"charts\\\": {\\\"r\\\": $i}}\"; done\n";
    let place = ran(
        program,
        "{ return: { key: charts/r, last: 2 } }",
        "      reads: { step: t }",
    );
    assert_eq!(
        values(&place, "train", "return"),
        ["150:1", "250:2", "350:3", "450:4", "550:5"]
    );
    assert_eq!(values(&place, "evaluate", "return"), ["200:1", "400:2.5"]);
    assert_eq!(values(&place, "final", "return"), ["1000:4.5"]);
    assert_eq!(values(&place, "final", "own_steps"), ["1000:550"]);
}

#[test]
fn words_on_either_stream_are_read() {
    let program = "echo 'INFO step=100 loss=0.5, done' >&2; printf '10 %%\\r50 %%\\rstep=200 r=3'\n";
    let place = ran(program, "{ return: r, loss: { key: loss, from: stderr } }", "");
    assert_eq!(values(&place, "train", "return"), ["200:3"]);
    assert_eq!(values(&place, "train", "loss"), ["100:0.5"]);
}

#[test]
fn lines_without_a_step_are_numbered() {
    let place = ran("echo r=1; echo r=2\n", "{ return: r }", "");
    assert_eq!(values(&place, "train", "return"), ["1:1", "2:2"]);
    assert_eq!(values(&place, "final", "return"), ["1000:2"]);
}

#[test]
fn lines_in_the_file_of_the_trial_are_read() {
    let program = "echo '{\"step\": 100, \"ret\": 1}' >> $REGIMEN_LOG; echo '{\"step\": 200, \"ret\": 4}' >> $REGIMEN_LOG\n";
    let place = ran(program, "{ return: ret }", "      reads: { from: log }");
    assert_eq!(values(&place, "train", "return"), ["100:1", "200:4"]);
    assert_eq!(values(&place, "evaluate", "return"), ["200:4"]);
}

#[test]
fn files_are_read_as_imported_ones_are() {
    let program = "mkdir -p runs/a; printf '#{\"t_start\": 1.0, \"env_id\": \"x\"}\\nr,l,t\\n1,100,0.1\\n2,100,0.2\\n' > \
                   runs/a/0.monitor.csv\nprintf 'step,loss\\n10,0.5\\n20,0.25\\n' > progress.csv\n";
    let metrics = "{ return: { key: r, from: \"runs/**/*.monitor.csv\", step: { sum: l } }, loss: { key: loss, from: progress.csv } }";
    let place = ran(program, metrics, "");
    assert_eq!(values(&place, "train", "return"), ["100:1", "200:2"]);
    assert_eq!(values(&place, "final", "loss"), ["1000:0.25"]);
}

#[test]
fn what_a_program_is_given_is_what_the_study_says() {
    let program = "echo r=1; printf '%s\\n' \"$PYTHONHASHSEED $OMP_NUM_THREADS $OWN ${PYTHONPATH#$PWD/} $2\" > told; ls -A > \
                   listed; cat \"$3\" >> told; [ \"$(cat told)\" = \"0 1 a b .regimen/python 1000\ncases\" ] || \
                   { cat told listed >&2; exit 1; }\n";
    let bench = Bench::new();
    bench.write("a.sh", program);
    bench.write("cases.txt", "cases");
    bench.write("other.txt", "not declared");
    let more = "      variables: { OWN: a b }\n      inputs: { cases: { file: cases.txt } }";
    let run = "[sh, a.sh, \"{seed}\", \"{steps}\", \"{input.cases}\"]";
    bench.write("study.yaml", &study_of(run, "{ return: r }", more));
    let place = Place { bench };
    let mut command = place.bench.command(&["run", "study.yaml", "--yes"]);
    let answer = command.env("PYTHONPATH", "/elsewhere").output().unwrap();
    assert!(answer.status.success(), "{}", place.trial()["end"]);
}
