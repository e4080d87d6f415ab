//! Runs in TensorBoard's event files: every folder is a run, which may go on in several files.

use super::{Content, Mapping, Run, input};
use crate::{
    Error,
    export::event_file::{Event, Scalar, events},
};
use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

/// The runs of all files, in the order of their folders.
pub(super) fn runs(files: &[&Content], mapping: &Mapping) -> Result<Vec<Run>, Error> {
    let (Some(first), columns) = (files.first(), columns(mapping)) else {
        return Ok(Vec::new());
    };
    if let Some(key) = columns {
        let problem = format!("event files have no columns; leave `{key}` out, every folder is a run");
        return Err(input(&first.path, None, None, problem));
    }
    let mut runs: BTreeMap<&Path, Run> = BTreeMap::new();
    for file in files {
        let folder = file.path.parent().unwrap_or(Path::new(""));
        let run = runs.entry(folder).or_insert_with(|| Run {
            name: format!("`{}`", folder.display()),
            ..Run::default()
        });
        let events = events(&file.bytes).map_err(|problem| input(&file.path, None, None, problem))?;
        take(file, &events, run, mapping)?;
    }
    Ok(runs.into_values().collect())
}

/// The tags of a file.
pub(super) fn tags(file: &Content) -> Result<Vec<String>, Error> {
    let events = events(&file.bytes).map_err(|problem| input(&file.path, None, None, problem))?;
    let scalars = events
        .iter()
        .filter_map(|event| event.summary.as_ref())
        .flat_map(|summary| &summary.value);
    Ok(scalars.map(|scalar| scalar.tag.clone()).collect())
}

/// A key of the mapping that names a column.
fn columns(mapping: &Mapping) -> Option<&'static str> {
    let given = [
        ("seed", mapping.seed.is_some()),
        ("run", mapping.run.is_some()),
        ("only", !mapping.only.is_empty()),
    ];
    given
        .into_iter()
        .find(|(_, is_given)| *is_given)
        .map(|(key, _)| key)
}

fn take(file: &Content, events: &[Event], run: &mut Run, mapping: &Mapping) -> Result<(), Error> {
    let mut tags: BTreeSet<&str> = BTreeSet::new();
    for event in events {
        for scalar in event.summary.iter().flat_map(|summary| &summary.value) {
            tags.insert(&scalar.tag);
            let wanted = mapping.metrics.iter().filter(|(_, tag)| **tag == scalar.tag);
            for (metric, tag) in wanted {
                let value = number(scalar).ok_or_else(|| {
                    let problem = format!("`{tag}` at step {} is no finite number", event.step);
                    input(&file.path, None, None, problem)
                })?;
                let step = u64::try_from(event.step).unwrap_or(0);
                run.curves.entry(metric.clone()).or_default().push((step, value));
            }
        }
    }
    // A run may go on in another file, so that only a file with other values and none of these is a mistake.
    let lacks_all = mapping.metrics.values().all(|tag| !tags.contains(tag.as_str()));
    if lacks_all && !tags.is_empty() {
        let known: Vec<&str> = tags.into_iter().collect();
        let problem = format!(
            "it has none of the tags of `metrics`; its tags are {}",
            known.join(", ")
        );
        return Err(input(&file.path, None, None, problem));
    }
    Ok(())
}

/// A scalar as the older or as the newer form keeps it.
fn number(scalar: &Scalar) -> Option<f64> {
    let of_tensor = || {
        let tensor = scalar.tensor.as_ref()?;
        let content = || tensor.tensor_content.as_slice();
        tensor
            .float_val
            .first()
            .map(|value| f64::from(*value))
            .or_else(|| tensor.double_val.first().copied())
            .or_else(|| Some(f64::from(f32::from_le_bytes(content().try_into().ok()?))))
            .or_else(|| Some(f64::from_le_bytes(content().try_into().ok()?)))
    };
    let value = scalar.simple_value.map(f64::from).or_else(of_tensor);
    value.filter(|value| value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::event_file::{Summary, Tensor, append, first};

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
            tensor: None,
        }
    }

    fn content(path: &str, events: &[Event]) -> Content {
        let mut bytes = Vec::new();
        append(&first(0.0), &mut bytes);
        events.iter().for_each(|event| append(event, &mut bytes));
        Content {
            path: path.into(),
            bytes,
        }
    }

    fn mapping() -> Mapping {
        Mapping {
            metrics: [("return".to_owned(), "charts/episodic_return".to_owned())].into(),
            ..Mapping::default()
        }
    }

    #[test]
    fn every_folder_is_a_run_and_both_forms_of_scalars_are_read() {
        let tag = "charts/episodic_return";
        let tensor = |tensor: Tensor| Scalar {
            tag: tag.into(),
            simple_value: None,
            tensor: Some(tensor),
        };
        let floats = Tensor {
            float_val: vec![2.5],
            ..Tensor::default()
        };
        let bytes = Tensor {
            tensor_content: 4.5f32.to_le_bytes().to_vec(),
            ..Tensor::default()
        };
        let one = content(
            "runs/a/events.out.tfevents.1",
            &[event(10, simple(tag, 1.5)), event(20, simple("loss", 9.0))],
        );
        let more = content(
            "runs/a/events.out.tfevents.2",
            &[event(20, tensor(floats)), event(30, tensor(bytes))],
        );
        let other = content("runs/b/events.out.tfevents.1", &[event(10, simple(tag, 7.0))]);
        let runs = runs(&[&one, &more, &other], &mapping()).unwrap();
        assert_eq!(runs.len(), 2);
        assert_eq!(runs[0].curves["return"], [(10, 1.5), (20, 2.5), (30, 4.5)]);
        assert_eq!(runs[1].name, "`runs/b`");
    }

    #[test]
    fn what_is_wrong_is_named() {
        let other = content("runs/a/events.out.tfevents.1", &[event(1, simple("loss", 1.0))]);
        let refused = |files: &[&Content], mapping: &Mapping| runs(files, mapping).unwrap_err().to_string();
        assert!(refused(&[&other], &mapping()).contains("its tags are loss"));
        let mut torn = content("a/x.tfevents", &[event(1, simple("charts/episodic_return", 1.0))]);
        let middle = torn.bytes.len() - 6;
        torn.bytes[middle] ^= 1;
        assert!(refused(&[&torn], &mapping()).contains("checksum"));
        let columns = Mapping {
            seed: Some("seed".into()),
            ..mapping()
        };
        assert!(refused(&[&other], &columns).contains("leave `seed` out"));
        let endless = content(
            "a/x.tfevents",
            &[event(1, simple("charts/episodic_return", f32::NAN))],
        );
        assert!(refused(&[&endless], &mapping()).contains("at step 1 is no finite number"));
    }
}
