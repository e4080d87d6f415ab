//! Members that train at once, in threads and over a socket, compared with the processor.

use crate::backend::Backend;
use crate::cohort::Cohort;
use crate::literal::LiteralProcessor;
use crate::population::Population;
use crate::socket::{Remote, serve};
use crate::{compiler, cuda};
use arithmetic::draws::{GOLDEN, mix, normal};
use plan::cuda::literal::has_compiler;
use plan::cuda::{Batch, Kernels};
use plan::executor::{Executor, Lost, with};
use plan::{Activation, Descent, Equations, Graph, Processor, State};
use std::ops::Range;
use std::os::unix::net::UnixListener;
use std::sync::{Arc, Mutex};
use std::thread;

#[path = "../../../tests/skipped.rs"]
mod skipped;

const N_MEMBERS: u64 = 5;

/// A plan with learning, clipping and random draws, and one that only acts.
fn plan() -> Graph {
    let equations = Equations::new();
    let (seen, wanted) = (
        equations.input("seen", [70, 3]),
        equations.input("wanted", [70, 1]),
    );
    let shapes = [[3, 20], [1, 20], [20, 1], [1, 1]];
    let parameters = [0, 1, 2, 3].map(|at| equations.parameter(&format!("network.{at}"), shapes[at]));
    let network = |x| {
        let [first, first_bias, second, second_bias] = parameters;
        let hidden = plan::Expression::dense(x, first, first_bias, Activation::Tanh);
        hidden.dense(second, second_bias, Activation::Identity)
    };
    let _ = equations.routine("learn");
    let noise = equations.normal([70, 3]);
    let loss = (network(seen + noise * 0.1) - wanted).square().mean();
    equations.output("loss", loss);
    equations.descend(loss, &parameters, &Descent::adam("rate", 0.01, Some(0.5)));
    let _ = equations.routine("act");
    equations.output("action", network(seen));
    equations.into_graph()
}

fn numbers(seed: u64, n: usize) -> Vec<f32> {
    let word = |at: u64| mix(seed.wrapping_mul(GOLDEN).wrapping_add(at));
    #[allow(clippy::cast_possible_truncation, reason = "the plan computes in f32")]
    (0..n as u64).map(|at| normal(word(at)) as f32).collect()
}

fn state(member: u64) -> State<f32> {
    let mut state = State::default();
    for (at, shape) in [[3, 20], [1, 20], [20, 1], [1, 1]].into_iter().enumerate() {
        let entries = numbers(member << 8 | at as u64, shape[0] * shape[1]);
        state.insert(format!("network.{at}"), shape, entries);
    }
    state
}

/// All bits of a member's results: losses, actions, and its state.
fn trained(member: u64) -> Vec<u32> {
    let (mut processor, mut state) = (Processor::<f32>::new(plan()), state(member));
    let mut found = Vec::new();
    for step in 0..6 {
        processor.write("seen", &numbers(member << 16 | step, 210));
        processor.write("wanted", &numbers(!(member << 16 | step), 70));
        processor.run_seeded("learn", &mut state, member << 32 | step);
        found.extend_from_slice(processor.entries("loss"));
        if step % 2 == 1 {
            processor.run("act", &mut state);
            found.extend_from_slice(processor.entries("action"));
        }
        if step == 3 {
            // A tensor that is changed here is written back to the member.
            state.entries_mut("network.3")[0] = 0.25;
        }
    }
    // A copy is a state of its own, which becomes another member.
    let mut copy = state.clone();
    processor.run_seeded("learn", &mut copy, 1);
    processor.run_seeded("learn", &mut state, 2);
    for (name, _, entries) in copy.tensors().chain(state.tensors()) {
        assert!(!entries.is_empty(), "{name}");
        found.extend_from_slice(entries);
    }
    found.iter().map(|x| x.to_bits()).collect()
}

fn alone() -> Vec<Vec<u32>> {
    (0..N_MEMBERS).map(trained).collect()
}

/// Members in a thread each, with an executor each.
fn at_once(executor: impl Fn() -> Arc<dyn Executor> + Sync) -> Vec<Vec<u32>> {
    let executor = &executor;
    thread::scope(|scope| {
        let members = (0..N_MEMBERS).map(|member| scope.spawn(move || with(&executor(), || trained(member))));
        let members: Vec<_> = members.collect();
        members.into_iter().map(|member| member.join().unwrap()).collect()
    })
}

/// A backend that records the sizes of its batches, and fails after a number of them.
struct Noted {
    backend: LiteralProcessor,
    sizes: Arc<Mutex<Vec<usize>>>,
    left: usize,
}

impl Backend for Noted {
    fn reserve(&mut self, cohort: usize, state_size: usize, n_members: usize) -> Result<(), Lost> {
        self.backend.reserve(cohort, state_size, n_members)
    }

    fn write(&mut self, cohort: usize, member: u32, first: usize, entries: &[f32]) -> Result<(), Lost> {
        self.backend.write(cohort, member, first, entries)
    }

    fn read(&mut self, cohort: usize, member: u32, entries: Range<usize>) -> Result<Vec<f32>, Lost> {
        self.backend.read(cohort, member, entries)
    }

    fn start(&mut self, cohort: usize, routine: usize, batch: &Batch<'_>) -> Result<(), Lost> {
        self.left = self.left.checked_sub(1).ok_or_else(|| Lost {
            reason: "the card is lost: it fell off the bus".into(),
        })?;
        self.sizes.lock().unwrap().push(batch.members.len());
        self.backend.start(cohort, routine, batch)
    }

    fn finish(&mut self) -> Result<Vec<f32>, Lost> {
        self.backend.finish()
    }
}

fn population(folder: &tempfile::TempDir, n_batches: usize) -> (Arc<dyn Executor>, Arc<Mutex<Vec<usize>>>) {
    let (path, sizes) = (folder.path().to_owned(), Arc::default());
    let noted = Arc::clone(&sizes);
    let open = move || {
        Ok(Noted {
            backend: LiteralProcessor::new(path),
            sizes: noted,
            left: n_batches,
        })
    };
    (Arc::new(Population::new(open).unwrap()), sizes)
}

#[test]
fn members_in_threads_have_the_bits_of_states_alone() {
    if !has_compiler() {
        return skipped::skip("`c++` is not on the path", "`apt-get install g++` installs it");
    }
    let folder = tempfile::tempdir().unwrap();
    let (executor, sizes) = population(&folder, usize::MAX);
    assert_eq!(at_once(|| Arc::clone(&executor)), alone());
    let sizes = sizes.lock().unwrap();
    // Eight steps of learning and three of acting for each member.
    assert_eq!(sizes.iter().sum::<usize>(), 11 * 5, "{sizes:?}");
    assert!(
        sizes.iter().any(|size| *size > 1),
        "no two runs shared a batch: {sizes:?}"
    );
}

#[test]
fn members_of_other_processes_have_the_bits_of_states_alone() {
    if !has_compiler() {
        return skipped::skip("`c++` is not on the path", "`apt-get install g++` installs it");
    }
    let folder = tempfile::tempdir().unwrap();
    let (executor, _) = population(&folder, usize::MAX);
    let socket = folder.path().join("socket");
    let listener = UnixListener::bind(&socket).unwrap();
    thread::spawn(move || serve(&listener, &executor));
    assert_eq!(at_once(|| Arc::new(Remote::new(&socket).unwrap())), alone());
}

#[test]
fn a_lost_card_ends_a_trial_with_a_sentence() {
    if !has_compiler() {
        return skipped::skip("`c++` is not on the path", "`apt-get install g++` installs it");
    }
    let folder = tempfile::tempdir().unwrap();
    let (executor, _) = population(&folder, 2);
    let socket = folder.path().join("socket");
    let listener = UnixListener::bind(&socket).unwrap();
    let served = Arc::clone(&executor);
    thread::spawn(move || serve(&listener, &served));
    let remote: Arc<dyn Executor> = Arc::new(Remote::new(&socket).unwrap());
    for executor in [executor, remote] {
        let panic = thread::spawn(move || with(&executor, || trained(0)))
            .join()
            .unwrap_err();
        let lost = panic.downcast_ref::<Lost>().unwrap();
        assert_eq!(lost.reason, "the card is lost: it fell off the bus");
    }
}

#[test]
fn states_of_one_shape_are_a_cohort_with_or_without_moments() {
    let of = |names: &[&str]| -> Vec<_> { names.iter().map(|name| ((*name).to_owned(), [2, 20])).collect() };
    let mut cohort = Cohort::new(&of(&["b", "a"]));
    assert!(cohort.takes(&of(&["a", "b", "a.first", "a.second"])));
    assert!(!cohort.takes(&of(&["a", "c"])) && !cohort.takes(&of(&["a"])));
    assert_eq!(cohort.tensor("a.second"), Ok(128..168));
    assert_eq!(
        cohort.tensor("c").unwrap_err().reason,
        "the learner's state has no tensor `c`"
    );
    assert_eq!([(); 3].map(|()| cohort.admit()), [0, 1, 2]);
    cohort.dismiss(2);
    cohort.dismiss(0);
    assert_eq!([(); 3].map(|()| cohort.admit()), [0, 2, 3]);
}

#[test]
fn kernels_compile_for_a_card() {
    if !compiler::has_compiler() {
        let remedy =
            "`pip install nvidia-cuda-nvrtc-cu12` installs it; LD_LIBRARY_PATH has to name its folder";
        return skipped::skip("the library libnvrtc is not found", remedy);
    }
    let graph = plan();
    for routine in ["learn", "act"] {
        let kernels = Kernels::new(&graph, graph.routine_named(routine).unwrap()).unwrap();
        let text = compiler::compile(&kernels).unwrap().to_src();
        for wave in &kernels.waves {
            assert!(text.contains(&format!(".entry {}(", wave.name)), "{}", wave.name);
        }
        // Sums, roots and quotients are not approximated.
        for word in ["fma.rn.ftz", "div.approx", "sqrt.approx", "div.full"] {
            assert!(!text.contains(word), "`{word}` in `{routine}`");
        }
    }
}

#[test]
fn a_machine_without_a_card_says_what_it_lacks() {
    if let Err(Lost { reason }) = cuda::Card::open(0) {
        let known = [
            "this machine has no driver",
            "the driver finds no card",
            "the card cannot be used",
        ];
        assert!(known.iter().any(|start| reason.starts_with(start)), "{reason}");
    }
}
