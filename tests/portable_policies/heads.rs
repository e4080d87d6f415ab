//! Every head after every activation, and where its outputs are extreme.

use super::*;

/// Channels of several magnitudes, of which one varies little around a large value and one is not to be seen.
fn ports(outputs: usize) -> Ports {
    let name = |at: usize| format!("entry_{at}");
    Ports {
        inputs: (0..4).map(name).collect(),
        center: vec![3.4, 101_325.37, 0.0, 7.0],
        spread: vec![0.2, 0.5, 1.0, f64::MAX],
        outputs: (0..outputs).map(name).collect(),
    }
}

#[test]
fn every_head_after_every_activation_acts_as_here() {
    let (cases, mut rng) = (Cases::new(), stream(&["portable", "heads"]));
    let Ports { center, spread, .. } = ports(3);
    for head in HEADS {
        for activation in [Activation::Relu, Activation::LeakyRelu, Activation::Tanh] {
            for (hidden, unused) in [
                (vec![], 0),
                (vec![activation], 3),
                (vec![activation, Activation::Tanh], 0),
            ] {
                let sizes = [vec![4], vec![16; hidden.len()], vec![3 + unused]].concat();
                let policy = Policy::untrained(&sizes, &hidden, ports(3), head, &mut rng);
                let rows = around(&center, &spread, &mut rng);
                cases.add_policy(
                    &format!("{head:?}-{activation:?}-{}", hidden.len()),
                    &policy,
                    &rows,
                );
            }
        }
        let policy = Policy::untrained(&[4, 8, 3], &[Activation::LeakyRelu], ports(3), head, &mut rng);
        let policy = policy.in_units(vec![700.0, 0.0, -1e-3], vec![50.0, 2.0, 1e-3]);
        let rows = around(&center, &spread, &mut rng);
        cases.add_policy(&format!("{head:?}-in-units"), &policy, &rows);
    }
    cases.hold();
}

#[test]
fn heads_hold_where_outputs_are_extreme() {
    let rows = [
        [1e4, 0.0, -1e4],
        [-80.0, -79.0, -85.0],
        [-20.0, -30.0, -25.0],
        [88.0, 89.0, 500.0],
        [0.0, 0.0, 0.0],
        [1e-8, -1e-8, 3.0],
        [-1.0, 2.0, 2.0],
    ];
    let rows = rows.map(|row| row.map(single).to_vec());
    let cases = Cases::new();
    for head in HEADS {
        let (mut graph, x) = Graph::of_observation(3);
        let action = graph.head(&x, head);
        let graph = graph.acting(&action, head.n_entries(3));
        cases.add(&format!("{head:?}"), &graph.to_bytes(&[]), &rows, |row| {
            head.apply(row)
        });
    }
    cases.hold();
}
