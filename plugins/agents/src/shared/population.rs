//! Check that members of a population learn as trials alone: one plan and many states on the processor, and the kernels
//! for a card with many states in one batch.

use card::{literal::LiteralProcessor, population::Population};
use contract::{Agent, Rng, random::stream};
use plan::{
    Plans,
    cuda::literal::has_compiler,
    executor::{Executor, with},
};
use std::{fs, path::Path, sync::Arc, thread};

#[path = "../../../../tests/skipped.rs"]
mod skipped;

/// Number of members.
const N_MEMBERS: usize = 4;
/// Places of the members in each round.
const ORDERS: [[usize; N_MEMBERS]; 3] = [[0, 1, 2, 3], [3, 1, 0, 2], [2, 3, 1, 0]];

/// Asserts that members that share the plans `plans` come to the bits of the same members with plans of their own, in
/// any order, and on kernels for a card. `train` has to make at least one update.
pub fn assert_members_learn_as_alone<A: Agent>(
    build: impl Fn(&mut Rng) -> A + Sync,
    plans: impl Fn(&mut A) -> &mut [Plans],
    train: impl Fn(&mut A, &mut Rng) + Sync,
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
    let on_kernels = has_compiler().then(|| saved_on_kernels(member, &train));
    if on_kernels.is_none() {
        let (missing, remedy) = ("`c++` is not on the path", "`apt-get install g++` installs it");
        skipped::skip_part("kernels for a card", missing, remedy);
    }
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
            on_kernels
                .as_ref()
                .is_none_or(|saved| saved[at] == alone_saved[at]),
            "member {at} has other bits on kernels for a card"
        );
        assert!(
            alone_saved[at] != alone_saved[(at + 1) % N_MEMBERS],
            "member {at} is its neighbour"
        );
    }
}

/// Names and bytes of the files of a checkpoint.
type Saved = Vec<(String, Vec<u8>)>;

/// Checkpoints of members that train at once, in a thread each, on kernels for a card that run literally.
fn saved_on_kernels<A: Agent>(
    member: impl Fn(usize) -> (A, Rng) + Sync,
    train: &(impl Fn(&mut A, &mut Rng) + Sync),
) -> Vec<Saved> {
    let folder = tempfile::tempdir().unwrap();
    let programs = folder.path().to_owned();
    let population = Population::new(move || Ok(LiteralProcessor::new(programs))).unwrap();
    let executor: Arc<dyn Executor> = Arc::new(population);
    let trained = |at| {
        let (mut agent, mut rng) = member(at);
        with(&executor, || {
            ORDERS.iter().for_each(|_| train(&mut agent, &mut rng));
            checkpoint(&agent)
        })
    };
    let trained = &trained;
    thread::scope(|scope| {
        let members = (0..N_MEMBERS).map(|at| scope.spawn(move || trained(at)));
        let members: Vec<_> = members.collect();
        members.into_iter().map(|member| member.join().unwrap()).collect()
    })
}

fn checkpoint(agent: &impl Agent) -> Saved {
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
