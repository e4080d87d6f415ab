//! NVIDIA's cards, used through their driver, which is loaded on first use.

#![allow(unsafe_code, reason = "the card computes on addresses")]

use crate::backend::Backend;
use crate::compiler::compile;
use cudarc::driver::sys::{CU_MEMHOSTALLOC_WRITECOMBINED, CUgraphInstantiate_flags, CUstreamCaptureMode};
use cudarc::driver::{
    CudaContext, CudaEvent, CudaFunction, CudaGraph, CudaSlice, CudaStream, DevicePtr, DeviceRepr,
    DriverError, LaunchConfig, PinnedHostSlice, PushKernelArg, ValidAsZeroBits,
};
use plan::cuda::{Batch, Kernels, THREADS, size};
use plan::executor::Lost;
use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;
use std::sync::Arc;

/// Oldest supported version of the driver's interface.
const OLDEST_DRIVER: i32 = 12000;

/// Arguments of a kernel: `Population` of `population.cuh`, with addresses on the card and sizes in entries.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Arguments {
    states: u64,
    inputs: u64,
    outputs: u64,
    values: u64,
    constants: u64,
    tensors: u64,
    members: u64,
    runs: u64,
    state_size: u64,
    input_size: u64,
    output_size: u64,
    value_size: u64,
    run_size: u32,
}

// SAFETY: the structure has the layout of C and no references.
unsafe impl DeviceRepr for Arguments {}

/// A card.
pub struct Card {
    stream: Arc<CudaStream>,
    /// States of each cohort, and their size.
    states: BTreeMap<usize, (usize, CudaSlice<f32>)>,
    routines: BTreeMap<usize, LoadedRoutine>,
    /// Values of the running routine.
    values: Option<CudaSlice<f32>>,
    flights: VecDeque<Flight>,
    /// Index of the buffers of the next batch.
    turn: usize,
}

/// A routine on the card.
struct LoadedRoutine {
    waves: Vec<(CudaFunction, u32)>,
    constants: CudaSlice<f32>,
    /// Memory of the running batches, which alternate.
    buffers: [Option<Buffers>; 2],
    /// Recorded launches by cohort, buffers and number of runs, with the arguments that they hold.
    graphs: BTreeMap<(usize, usize, u32), (Arguments, CudaGraph)>,
}

impl LoadedRoutine {
    /// Launches all kernels as one graph, which is recorded first if there is none with these arguments.
    fn launch(
        &mut self,
        stream: &Arc<CudaStream>,
        key: (usize, usize, u32),
        arguments: Arguments,
    ) -> Result<(), Lost> {
        if self.graphs.get(&key).is_none_or(|(of, _)| *of != arguments) {
            let graph = record(stream, &self.waves, key.2, &arguments)?;
            self.graphs.insert(key, (arguments, graph));
        }
        self.graphs[&key].1.launch().map_err(lost)
    }
}

/// Memory for a number of runs, on the card and, for what is copied, on the host.
struct Buffers {
    n_runs: usize,
    inputs: CudaSlice<f32>,
    outputs: CudaSlice<f32>,
    tensors: CudaSlice<u32>,
    members: CudaSlice<u32>,
    runs: CudaSlice<u32>,
    inputs_here: PinnedHostSlice<f32>,
    outputs_here: PinnedHostSlice<f32>,
}

impl Buffers {
    /// Arguments of a batch, with the addresses of its states, other values and constants.
    fn arguments(
        &self,
        stream: &Arc<CudaStream>,
        batch: &Batch<'_>,
        [states, values, constants]: [u64; 3],
    ) -> Arguments {
        let kernels = batch.kernels;
        let [inputs, outputs] = [&self.inputs, &self.outputs].map(|buffer| buffer.device_ptr(stream).0);
        let [tensors, members, runs] =
            [&self.tensors, &self.members, &self.runs].map(|buffer| buffer.device_ptr(stream).0);
        Arguments {
            states,
            inputs,
            outputs,
            values,
            constants,
            tensors,
            members,
            runs,
            state_size: batch.state_size as u64,
            input_size: size(&kernels.inputs) as u64,
            output_size: size(&kernels.outputs) as u64,
            value_size: kernels.value_size as u64,
            run_size: word(kernels.run_size()),
        }
    }

    /// Copies members, words and inputs of a batch to the card.
    fn upload(&mut self, stream: &Arc<CudaStream>, batch: &Batch<'_>) -> Result<(), Lost> {
        let members = std::iter::once(word(batch.members.len())).chain(batch.members.iter().copied());
        let members: Vec<u32> = members.collect();
        stream
            .memcpy_htod(batch.tensors, &mut self.tensors)
            .map_err(lost)?;
        stream.memcpy_htod(&members, &mut self.members).map_err(lost)?;
        stream
            .memcpy_htod(&batch.runs.concat(), &mut self.runs)
            .map_err(lost)?;
        let mut first = 0;
        let here = self.inputs_here.as_mut_slice().map_err(lost)?;
        for inputs in batch.inputs {
            here[first..][..inputs.len()].copy_from_slice(inputs);
            first += inputs.len();
        }
        if first > 0 {
            stream
                .memcpy_htod(&self.inputs_here, &mut self.inputs)
                .map_err(lost)?;
        }
        Ok(())
    }
}

/// A running batch.
struct Flight {
    routine: usize,
    turn: usize,
    /// Number of entries of its outputs.
    length: usize,
    done: CudaEvent,
}

/// A sentence for an error of the driver.
fn lost(error: DriverError) -> Lost {
    use cudarc::driver::sys::CUresult;
    let said = error.error_string().map_or_else(
        |_| format!("{error:?}"),
        |text| text.to_string_lossy().into_owned(),
    );
    Lost {
        reason: match error.0 {
            CUresult::CUDA_ERROR_OUT_OF_MEMORY => {
                "the card has no memory left for this population: run fewer trials at a time with --jobs"
                    .into()
            }
            CUresult::CUDA_ERROR_UNSUPPORTED_PTX_VERSION => {
                "the compiler NVRTC is newer than the driver: install one of the driver's version of CUDA, or an older one"
                    .into()
            }
            CUresult::CUDA_ERROR_NO_DEVICE => "the driver finds no card".into(),
            CUresult::CUDA_ERROR_ECC_UNCORRECTABLE
            | CUresult::CUDA_ERROR_ILLEGAL_ADDRESS
            | CUresult::CUDA_ERROR_LAUNCH_FAILED => format!("the card is lost: {said}"),
            _ => format!("the card cannot be used: {said}"),
        },
    }
}

impl Card {
    /// Opens a card by its number.
    ///
    /// # Errors
    /// A sentence that names what the machine lacks.
    pub fn open(number: usize) -> Result<Self, Lost> {
        // SAFETY: the function opens the library and closes it again, and no thread uses it in between.
        if !unsafe { cudarc::driver::sys::is_culib_present() } {
            let reason = "this machine has no driver of NVIDIA: the library libcuda is not found";
            return Err(Lost {
                reason: reason.into(),
            });
        }
        let context = CudaContext::new(number).map_err(lost)?;
        let mut version = 0;
        // SAFETY: the address is that of a number of the right type.
        let asked = unsafe { cudarc::driver::sys::cuDriverGetVersion(&raw mut version) };
        asked.result().map_err(lost)?;
        if version < OLDEST_DRIVER {
            let shown = |version: i32| format!("{}.{}", version / 1000, version % 1000 / 10);
            let (found, oldest) = (shown(version), shown(OLDEST_DRIVER));
            let reason = format!("the driver is too old: it knows CUDA {found}, and {oldest} is needed");
            return Err(Lost { reason });
        }
        // SAFETY: one thread uses one stream, so all work is in order.
        unsafe { context.disable_event_tracking() };
        let stream = context.new_stream().map_err(lost)?;
        Ok(Self {
            stream,
            states: BTreeMap::new(),
            routines: BTreeMap::new(),
            values: None,
            flights: VecDeque::new(),
            turn: 0,
        })
    }

    /// Name and memory of the card, in words.
    ///
    /// # Errors
    /// [`Lost`] if the driver fails.
    pub fn in_words(&self) -> Result<String, Lost> {
        let context = self.stream.context();
        let (name, bytes) = (context.name().map_err(lost)?, context.total_mem().map_err(lost)?);
        Ok(format!("{name} with {} GiB", bytes >> 30))
    }

    /// Zeros; at least one, since the driver allocates no empty memory.
    fn zeros<T: DeviceRepr + ValidAsZeroBits>(&self, length: usize) -> Result<CudaSlice<T>, Lost> {
        self.stream.alloc_zeros(length.max(1)).map_err(lost)
    }

    fn load(&mut self, routine: usize, kernels: &Kernels) -> Result<(), Lost> {
        if self.routines.contains_key(&routine) {
            return Ok(());
        }
        let module = self
            .stream
            .context()
            .load_module(compile(kernels)?)
            .map_err(lost)?;
        let wave = |wave: &plan::cuda::Wave| {
            let function = module.load_function(&wave.name).map_err(lost)?;
            Ok((function, word(wave.blocks)))
        };
        let waves = kernels.waves.iter().map(wave).collect::<Result<_, Lost>>()?;
        let mut constants = self.zeros(kernels.constants.len())?;
        let entries: Vec<f32> = kernels
            .constants
            .iter()
            .map(|bits| f32::from_bits(*bits))
            .collect();
        if !entries.is_empty() {
            self.stream.memcpy_htod(&entries, &mut constants).map_err(lost)?;
        }
        let loaded = LoadedRoutine {
            waves,
            constants,
            buffers: [None, None],
            graphs: BTreeMap::new(),
        };
        self.routines.insert(routine, loaded);
        Ok(())
    }

    fn buffers(&self, kernels: &Kernels, n_runs: usize) -> Result<Buffers, Lost> {
        let [inputs, outputs] = [&kernels.inputs, &kernels.outputs].map(|spans| n_runs * size(spans));
        let context = self.stream.context();
        // SAFETY: the entries are written before the card or anybody else reads them.
        let pinned = |length: usize, flags| {
            unsafe { context.alloc_pinned_with_flags(length.max(1), flags) }.map_err(lost)
        };
        Ok(Buffers {
            n_runs,
            inputs: self.zeros(inputs)?,
            outputs: self.zeros(outputs)?,
            tensors: self.zeros(kernels.tensors.len())?,
            members: self.zeros(1 + n_runs)?,
            runs: self.zeros(n_runs * kernels.run_size())?,
            // Such memory is fast to write and slow to read on the host.
            inputs_here: pinned(inputs, CU_MEMHOSTALLOC_WRITECOMBINED)?,
            outputs_here: pinned(outputs, 0)?,
        })
    }

    /// Memory for `n_runs` runs of a routine.
    fn provide(&mut self, routine: usize, kernels: &Kernels, n_runs: usize) -> Result<(), Lost> {
        self.load(routine, kernels)?;
        let turn = self.turn;
        let there = self.routines[&routine].buffers[turn].as_ref();
        if there.is_none_or(|buffers| buffers.n_runs < n_runs) {
            let buffers = self.buffers(kernels, n_runs)?;
            if let Some(loaded) = self.routines.get_mut(&routine) {
                loaded.buffers[turn] = Some(buffers);
            }
        }
        let length = n_runs * kernels.value_size;
        if self.values.as_ref().is_none_or(|values| values.len() < length) {
            // The old memory must be free, including for the running batch, before new memory is allocated.
            self.stream.synchronize().map_err(lost)?;
            self.values = None;
            self.values = Some(self.zeros(length)?);
        }
        Ok(())
    }

    /// Has the outputs of the last launched batch, `length` entries, copied to the host, and adds it to the running
    /// ones.
    fn follow(&mut self, routine: usize, length: usize) -> Result<(), Lost> {
        let turn = self.turn;
        let loaded = self.routines.get_mut(&routine);
        let buffers = loaded.and_then(|loaded| loaded.buffers[turn].as_mut());
        if let Some(Buffers {
            outputs,
            outputs_here,
            ..
        }) = buffers.filter(|_| length > 0)
        {
            self.stream.memcpy_dtoh(outputs, outputs_here).map_err(lost)?;
        }
        let done = self.stream.record_event(None).map_err(lost)?;
        self.flights.push_back(Flight {
            routine,
            turn,
            length,
            done,
        });
        self.turn = 1 - turn;
        Ok(())
    }

    fn state(&mut self, cohort: usize) -> Result<&mut (usize, CudaSlice<f32>), Lost> {
        self.states.get_mut(&cohort).ok_or_else(|| Lost {
            reason: format!("cohort {cohort} has no memory on the card"),
        })
    }
}

/// A number of blocks, members or entries; all are below 2^32 on any card.
fn word(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}

impl Backend for Card {
    fn reserve(&mut self, cohort: usize, state_size: usize, n_members: usize) -> Result<(), Lost> {
        let there = self.states.get(&cohort).map_or(0, |(_, states)| states.len());
        if there >= (n_members * state_size).max(1) {
            return Ok(());
        }
        let mut states = self.zeros(n_members.next_power_of_two() * state_size)?;
        if let Some((_, old)) = self.states.get(&cohort) {
            let mut front = states.slice_mut(..old.len());
            self.stream.memcpy_dtod(old, &mut front).map_err(lost)?;
        }
        self.states.insert(cohort, (state_size, states));
        Ok(())
    }

    fn write(&mut self, cohort: usize, member: u32, first: usize, entries: &[f32]) -> Result<(), Lost> {
        let stream = Arc::clone(&self.stream);
        let (size, states) = self.state(cohort)?;
        let first = member as usize * *size + first;
        let mut own = states.slice_mut(first..first + entries.len());
        stream.memcpy_htod(entries, &mut own).map_err(lost)?;
        stream.synchronize().map_err(lost)
    }

    fn read(&mut self, cohort: usize, member: u32, entries: Range<usize>) -> Result<Vec<f32>, Lost> {
        let stream = Arc::clone(&self.stream);
        let (size, states) = self.state(cohort)?;
        let first = member as usize * *size;
        let own = states.slice(first + entries.start..first + entries.end);
        let read = stream.clone_dtoh(&own).map_err(lost)?;
        stream.synchronize().map_err(lost)?;
        Ok(read)
    }

    fn start(&mut self, cohort: usize, routine: usize, batch: &Batch<'_>) -> Result<(), Lost> {
        // Rounding limits the numbers of runs that need launches of their own; blocks of places without a run end
        // immediately.
        let n_runs = batch.members.len().next_power_of_two();
        self.provide(routine, batch.kernels, n_runs)?;
        let (stream, turn) = (Arc::clone(&self.stream), self.turn);
        let states = self.state(cohort)?.1.device_ptr(&stream).0;
        let values = self.values.as_ref();
        let values = values.map_or(0, |values| values.device_ptr(&stream).0);
        // `provide` has loaded both.
        let Some(loaded) = self.routines.get_mut(&routine) else {
            unreachable!("routine {routine} is not loaded")
        };
        let constants = loaded.constants.device_ptr(&stream).0;
        let Some(buffers) = &mut loaded.buffers[turn] else {
            unreachable!("routine {routine} has no buffers")
        };
        buffers.upload(&stream, batch)?;
        let arguments = buffers.arguments(&stream, batch, [states, values, constants]);
        loaded.launch(&stream, (cohort, turn, word(n_runs)), arguments)?;
        self.follow(routine, batch.members.len() * size(&batch.kernels.outputs))
    }

    fn finish(&mut self) -> Result<Vec<f32>, Lost> {
        let Some(Flight {
            routine,
            turn,
            length,
            done,
        }) = self.flights.pop_front()
        else {
            return Ok(Vec::new());
        };
        done.synchronize().map_err(lost)?;
        let buffers = self.routines[&routine].buffers[turn].as_ref();
        let outputs = buffers.map_or(Ok(&[][..]), |buffers| buffers.outputs_here.as_slice());
        Ok(outputs.map_err(lost)?[..length].to_vec())
    }
}

/// All kernels of a routine as one graph, which is launched at once.
fn record(
    stream: &Arc<CudaStream>,
    waves: &[(CudaFunction, u32)],
    n_runs: u32,
    arguments: &Arguments,
) -> Result<CudaGraph, Lost> {
    let mode = CUstreamCaptureMode::CU_STREAM_CAPTURE_MODE_THREAD_LOCAL;
    stream.begin_capture(mode).map_err(lost)?;
    let launched = waves.iter().try_for_each(|(function, blocks)| {
        let shape = LaunchConfig {
            grid_dim: (*blocks, n_runs, 1),
            block_dim: (word(THREADS), 1, 1),
            shared_mem_bytes: 0,
        };
        let mut launch = stream.launch_builder(function);
        launch.arg(arguments);
        // SAFETY: the kernel has this one argument, and its blocks and members are those for which the memory was taken.
        unsafe { launch.launch(shape) }.map(drop).map_err(lost)
    });
    let graph = stream.end_capture(CUgraphInstantiate_flags(0)).map_err(lost)?;
    launched?;
    graph.ok_or_else(|| Lost {
        reason: "the card cannot be used: the kernels of a routine were not recorded".into(),
    })
}
