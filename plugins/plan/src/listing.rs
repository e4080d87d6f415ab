//! A plan as text, its floating-point operations and its memory traffic.
//!
//! Steps whose results are never read are left out, here and in executors.

use crate::cuda::Kernels;
use crate::graph::{Graph, Routine, Shape, Step, Value};
use crate::updates::Update;
use std::fmt::{Display, Formatter, Result};

impl Graph {
    /// Floating-point operations of one run: a product takes 2 for each row, column and inner index, an entry 1 for
    /// each function, sum or activation, a step of Adam 12 and of a moving average 3 an entry.
    #[must_use]
    pub fn flops(&self, routine: Routine) -> u64 {
        let of = |step: &&Step| match step {
            Step::Compute(value) => {
                let node = &self.nodes[value.0];
                let operands: Vec<Shape> = node.operands.iter().map(|it| self.shape(*it)).collect();
                node.operation.flops(&operands, node.shape)
            }
            Step::Update(update) => {
                let each = match update {
                    Update::Adam { .. } => 12,
                    Update::Follow { .. } => 3,
                    Update::Assign { .. } => 0,
                };
                each * self.entries(update.target())
            }
        };
        self.live_steps(routine.0).iter().map(of).sum()
    }

    /// Bytes that one run reads and writes in `f32` if every operation reads its operands and writes its result. An
    /// executor that fuses operations moves fewer.
    #[must_use]
    pub fn bytes(&self, routine: Routine) -> u64 {
        let of = |step: &&Step| match step {
            Step::Compute(value) => {
                let operands = self.nodes[value.0].operands.iter();
                self.entries(*value) + operands.map(|it| self.entries(*it)).sum::<u64>()
            }
            Step::Update(update) => {
                let each = match update {
                    Update::Adam { .. } => 7,
                    Update::Follow { .. } => 3,
                    Update::Assign { .. } => 2,
                };
                each * self.entries(update.target())
            }
        };
        4 * self.live_steps(routine.0).iter().map(of).sum::<u64>()
    }

    fn entries(&self, value: Value) -> u64 {
        let [rows, columns] = self.shape(value);
        rows as u64 * columns as u64
    }

    /// A value's name or number, and its shape.
    pub(crate) fn shown(&self, value: Value) -> String {
        format!("{} {:?}", self.label(value), self.shape(value))
    }

    fn label(&self, value: Value) -> String {
        let name = self.nodes[value.0].name.as_ref();
        name.map_or_else(|| format!("%{}", value.0), |name| format!("`{name}`"))
    }

    fn write_step(&self, step: &Step, f: &mut Formatter) -> Result {
        match step {
            Step::Compute(value) => {
                let node = &self.nodes[value.0];
                let operands: Vec<String> = node.operands.iter().map(|it| self.shown(*it)).collect();
                write!(f, "  {} = {}", self.shown(*value), node.operation)?;
                // Some draws have no operands.
                let of = if operands.is_empty() { "" } else { " of " };
                writeln!(f, "{of}{}", operands.join(", "))
            }
            Step::Update(update) => {
                let (target, source) = (self.shown(update.target()), self.shown(update.source()));
                match update {
                    Update::Adam { settings, .. } => {
                        let (rate, _) = &self.numbers[settings.learning_rate.0];
                        writeln!(
                            f,
                            "  {target} <- Adam by {source}, rate `{rate}`, betas {:?}",
                            settings.betas
                        )
                    }
                    Update::Follow { tau, .. } => writeln!(f, "  {target} <- Follow {source}, tau {tau}"),
                    Update::Assign { .. } => writeln!(f, "  {target} <- {source}"),
                }
            }
        }
    }
}

impl Display for Graph {
    /// Routine by routine, a line for each operation.
    fn fmt(&self, f: &mut Formatter) -> Result {
        for (at, routine) in self.routines.iter().enumerate() {
            let (flops, bytes) = (self.flops(Routine(at)), self.bytes(Routine(at)));
            let on_a_card = match Kernels::new(self, Routine(at)) {
                Ok(kernels) => format!("kernels for a card: {}", kernels.waves.len()),
                Err(missing) => missing.to_string(),
            };
            writeln!(
                f,
                "{}: {flops} operations, {bytes} bytes, {on_a_card}",
                routine.name
            )?;
            for step in self.live_steps(at) {
                self.write_step(step, f)?;
            }
        }
        Ok(())
    }
}
