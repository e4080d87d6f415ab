use super::{
    super::{content::content as written, mapping::Restart},
    *,
};
use crate::event_file::{Length, SessionLog, Shape, Summary, append, first};

const TAG: &str = "charts/episodic_return";

fn event(step: i64, scalar: Scalar) -> Event {
    Event {
        step,
        summary: Some(Summary { value: vec![scalar] }),
        ..Event::default()
    }
}

fn simple(tag: &str, value: f32) -> Scalar {
    Scalar {
        tag: tag.into(),
        simple_value: Some(value),
        ..Scalar::default()
    }
}

fn returned(step: i64, value: f32) -> Event {
    event(step, simple(TAG, value))
}

fn start(step: i64) -> Event {
    Event {
        step,
        session_log: Some(SessionLog { status: 1 }),
        ..Event::default()
    }
}

fn content_of(version: Option<&str>, path: &str, events: &[Event]) -> Content {
    let mut bytes = Vec::new();
    if let Some(version) = version {
        append(
            &Event {
                file_version: Some(version.into()),
                ..first(0.0)
            },
            &mut bytes,
        );
    }
    events.iter().for_each(|event| append(event, &mut bytes));
    written(path, bytes)
}

fn content(path: &str, events: &[Event]) -> Content {
    content_of(Some("brain.Event:2"), path, events)
}

fn mapping() -> Mapping {
    Mapping {
        metrics: [("return".to_owned(), TAG.into())].into(),
        ..Mapping::default()
    }
}

fn read(files: &[Content], mapping: &Mapping) -> Result<RunCollection, String> {
    let files: Vec<&Content> = files.iter().collect();
    let mut found = RunCollection::default();
    runs(&files, mapping, &mut found).map_err(|error| error.to_string())?;
    Ok(found)
}

fn curve(found: &RunCollection, run: usize) -> &[(u64, f64)] {
    &found.runs[run].curves["return"]
}

const A1: &str = "runs/a/events.out.tfevents.1";
const A2: &str = "runs/a/events.out.tfevents.2";

/// A value in each form of a tensor that holds one: 2.5, 4.5, 0.1, 0.3, 7 and -8.
fn tensors() -> [Tensor; 6] {
    let of = |dtype: i32, bytes: &[u8]| Tensor {
        dtype,
        tensor_content: bytes.to_vec(),
        ..Tensor::default()
    };
    [
        Tensor {
            float_val: vec![2.5],
            ..Tensor::default()
        },
        of(1, &4.5f32.to_le_bytes()),
        of(2, &0.1f64.to_le_bytes()),
        Tensor {
            dtype: 2,
            double_val: vec![0.3],
            ..Tensor::default()
        },
        of(3, &7i32.to_le_bytes()),
        Tensor {
            dtype: 9,
            int64_val: vec![-8],
            ..Tensor::default()
        },
    ]
}

#[test]
fn every_folder_is_a_run_and_all_forms_of_scalars_are_read() {
    let one = content(A1, &[returned(10, 1.5), event(20, simple("loss", 9.0))]);
    let scalar = |tensor: Tensor| Scalar {
        tag: TAG.into(),
        tensor: Some(tensor),
        ..Scalar::default()
    };
    let steps = (20..).step_by(10);
    let events: Vec<Event> = steps
        .zip(tensors())
        .map(|(step, tensor)| event(step, scalar(tensor)))
        .collect();
    let files = [
        one,
        content(A2, &events),
        content("runs/b/events.out.tfevents.1", &[returned(10, 7.0)]),
    ];
    let found = read(&files, &mapping()).unwrap();
    assert_eq!(found.runs.len(), 2);
    assert_eq!(
        curve(&found, 0),
        [
            (10, 1.5),
            (20, 2.5),
            (30, 4.5),
            (40, 0.1),
            (50, 0.3),
            (60, 7.0),
            (70, -8.0)
        ]
    );
    assert_eq!(found.runs[1].name, "`runs/b`");
    let per_file = Mapping {
        run_per: Some(RunPer::File),
        ..mapping()
    };
    assert_eq!(read(&files, &per_file).unwrap().runs.len(), 3);
}

#[test]
fn a_start_purges_what_was_logged_from_its_step_on() {
    let crashed = content(A1, &[returned(50, 1.0), returned(100, 2.0), returned(150, 3.0)]);
    let again = content(A2, &[start(100), returned(100, 4.0), returned(200, 5.0)]);
    let found = read(&[crashed, again], &mapping()).unwrap();
    assert_eq!(curve(&found, 0), [(50, 1.0), (100, 4.0), (200, 5.0)]);
    assert_eq!(found.purged, 2);
}

#[test]
fn files_of_the_older_form_purge_by_steps_that_go_back() {
    let events = [
        returned(50, 1.0),
        event(50, simple("loss", 1.0)),
        returned(100, 2.0),
        returned(60, 3.0),
        returned(70, 4.0),
    ];
    for version in [None, Some("brain.Event:1")] {
        let found = read(&[content_of(version, A1, &events)], &mapping()).unwrap();
        assert_eq!(curve(&found, 0), [(50, 1.0), (60, 3.0), (70, 4.0)]);
    }
}

#[test]
fn two_runs_in_a_folder_are_refused_or_told_apart() {
    let one = content(A1, &[returned(0, 1.0), returned(100, 2.0)]);
    let two = content(A2, &[returned(0, 3.0), returned(100, 4.0)]);
    let files = [one, two];
    let told = read(&files, &mapping()).map(|_| ()).unwrap_err();
    assert!(
        told.contains("tfevents.2`: it has steps that `runs/a/events.out.tfevents.1` has")
            && told.contains("`run_per: file`"),
        "{told}"
    );
    let per_file = Mapping {
        run_per: Some(RunPer::File),
        ..mapping()
    };
    assert_eq!(read(&files, &per_file).unwrap().runs.len(), 2);
    let new_run = Mapping {
        restart: Some(Restart::NewRun),
        ..mapping()
    };
    assert_eq!(curve(&read(&files, &new_run).unwrap(), 1), [(0, 3.0), (100, 4.0)]);
    let resume = Mapping {
        restart: Some(Restart::Resume),
        ..mapping()
    };
    assert_eq!(curve(&read(&files, &resume).unwrap(), 0), [(0, 3.0), (100, 4.0)]);
    let back = [content(A1, &[returned(10, 1.0), returned(5, 2.0)])];
    assert!(
        read(&back, &mapping())
            .map(|_| ())
            .unwrap_err()
            .contains("record 3: step 5 comes after step 10 (record 2)")
    );
}

#[test]
fn values_of_one_step_in_one_file_are_of_one_run() {
    let found = read(
        &[content(A1, &[returned(10, 1.0), returned(10, 3.0)])],
        &mapping(),
    )
    .unwrap();
    assert_eq!(
        (curve(&found, 0), found.repeated),
        (&[(10, 1.0), (10, 3.0)][..], 1)
    );
}

#[test]
fn tags_that_share_a_pattern_are_runs() {
    let events = [
        event(1, simple("agent_0/return", 1.0)),
        event(1, simple("agent_1/return", 2.0)),
    ];
    let pattern = Mapping {
        metrics: [("return".to_owned(), "*/return".into())].into(),
        ..Mapping::default()
    };
    assert_eq!(read(&[content(A1, &events)], &pattern).unwrap().runs.len(), 2);
    let odd = [
        event(1, simple("a*b, \"c\" ü", 1.0)),
        event(1, simple("axb, \"c\" ü", 2.0)),
    ];
    let exact = Mapping {
        metrics: [("return".to_owned(), "a*b, \"c\" ü".into())].into(),
        ..Mapping::default()
    };
    assert_eq!(curve(&read(&[content(A1, &odd)], &exact).unwrap(), 0), [(1, 1.0)]);
}

#[test]
fn a_folder_without_values_is_a_run_without_values() {
    let found = read(
        &[
            content(A1, &[returned(1, 1.0)]),
            content("runs/c/events.out.tfevents.1", &[]),
        ],
        &mapping(),
    )
    .unwrap();
    assert!(found.runs[1].curves.is_empty());
    assert_eq!(found.runs[1].file, PathBuf::from("runs/c/events.out.tfevents.1"));
}

#[test]
fn what_is_wrong_is_named() {
    let refused = |file: Content, mapping: &Mapping| read(&[file], mapping).map(|_| ()).unwrap_err();
    let other = || content(A1, &[event(1, simple("loss", 1.0))]);
    assert!(
        refused(other(), &mapping()).contains("it has no tag `charts/episodic_return`; its tags are loss")
    );
    let mut torn = content("a/x.tfevents", &[returned(1, 1.0)]);
    let middle = torn.bytes.len() - 6;
    torn.bytes[middle] ^= 1;
    assert!(refused(torn, &mapping()).contains("checksum"));
    let columns = Mapping {
        seed: Some("seed".into()),
        ..mapping()
    };
    assert!(refused(other(), &columns).contains("leave `seed` out"));
    let endless = || content(A1, &[returned(1, f32::NAN), returned(2, 5.0)]);
    assert!(
        refused(endless(), &mapping())
            .contains("record 2, tag `charts/episodic_return`: `NaN` at step 1 is not finite")
    );
    let left_out = Mapping {
        leave_out: [LeftOut::NotFinite].into(),
        ..mapping()
    };
    let found = read(&[endless()], &left_out).unwrap();
    assert_eq!((curve(&found, 0), found.not_finite), (&[(2, 5.0)][..], 1));
    assert!(refused(content(A1, &[returned(-1, 1.0)]), &mapping()).contains("step -1 is negative"));
    let two = Shape {
        dim: vec![Length { size: 2 }],
    };
    let vector = Tensor {
        dtype: 1,
        shape: Some(two),
        float_val: vec![1.0, 2.0],
        ..Tensor::default()
    };
    let vector = event(
        1,
        Scalar {
            tag: TAG.into(),
            tensor: Some(vector),
            ..Scalar::default()
        },
    );
    assert!(
        refused(content(A1, &[vector, event(1, simple("loss", 1.0))]), &mapping())
            .contains("holds no single numbers; tags that do are loss")
    );
}
