//! The one integration binary: everything here goes through the real program.

mod architecture;
mod contracts;
mod experiments;
mod identity;
mod other_programs;
mod pins;
mod program;
mod rollout;
mod runs;
