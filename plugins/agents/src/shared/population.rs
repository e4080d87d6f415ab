//! Check that members of a population learn as trials alone: one plan, many states.

use contract::{Agent, Rng, random::stream};
use plan::Plans;
use std::{fs, path::Path};

/// Number of members.
const N_MEMBERS: usize = 4;
/// Places of the members in each round.
const ORDERS: [[usize; N_MEMBERS]; 3] = [[0, 1, 2, 3], [3, 1, 0, 2], [2, 3, 1, 0]];

/// Asserts that members that share the plans `plans` come to the bits of the same members with plans of their own, in
/// any order. `train` has to make at least one update.
pub fn assert_members_learn_as_alone<A: Agent>(
    build: impl Fn(&mut Rng) -> A,
    plans: impl Fn(&mut A) -> &mut [Plans],
    train: impl Fn(&mut A, &mut Rng),
) {
    let member = |n: usize| {
        let mut rng = stream(&["member", &n.to_string()]);
        (build(&mut rng), rng)
    };
    let [mut alone, mut together] = [(); 2].map(|()| (0..N_MEMBERS).map(member).collect::<Vec<_>>());
    let mut shared = vec![Plans::default(); plans(&mut alone[0].0).len()];
    for at in ORDERS.into_iter().flatten() {
        let (agent, rng) = &mut alone[at];
        train(agent, rng);
        let (agent, rng) = &mut together[at];
        plans(agent).swap_with_slice(&mut shared);
        train(agent, rng);
        plans(agent).swap_with_slice(&mut shared);
    }
    let saved = |members: &[(A, Rng)]| {
        members
            .iter()
            .map(|(agent, _)| checkpoint(agent))
            .collect::<Vec<_>>()
    };
    let [alone_saved, together_saved] = [saved(&alone), saved(&together)];
    for at in 0..N_MEMBERS {
        assert!(
            alone[at].0.updates().is_some_and(|updates| updates.made > 0),
            "member {at}"
        );
        assert!(
            together_saved[at] == alone_saved[at],
            "member {at} has other bits than alone"
        );
        assert!(
            alone_saved[at] != alone_saved[(at + 1) % N_MEMBERS],
            "member {at} is its neighbour"
        );
    }
}

/// Names and bytes of the files of an agent's checkpoint.
fn checkpoint(agent: &impl Agent) -> Vec<(String, Vec<u8>)> {
    let dir = tempfile::tempdir().unwrap();
    agent.save(dir.path()).unwrap();
    let read = |path: &Path| {
        (
            path.file_name().unwrap().to_string_lossy().into_owned(),
            fs::read(path).unwrap(),
        )
    };
    let mut files: Vec<_> = fs::read_dir(dir.path())
        .unwrap()
        .map(|entry| read(&entry.unwrap().path()))
        .collect();
    files.sort();
    files
}
