//! The one integration binary: everything here goes through the real program.

mod architecture;
mod contracts;
mod experiments;
mod other_programs;
mod program;
mod rollout;
mod runs;
mod slurm;
