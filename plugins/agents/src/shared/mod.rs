//! Components that several agents share: buffers, checkpoints, schedules, layouts of seats, and the frame of
//! the algorithms with opponent models.

pub mod acting;
pub mod allocation;
#[cfg(test)]
pub(crate) mod bandit;
pub mod batch;
pub mod bellman;
pub mod box_seat;
pub mod checkpoint;
pub mod choice_seat;
#[cfg(test)]
pub(crate) mod coordination;
pub mod dataset_actor;
pub(crate) mod designs;
#[cfg(test)]
pub(crate) mod gradient_checks;
pub(crate) mod gradient_moments;
pub mod joint;
pub mod opponent_modelling;
pub(crate) mod policy_forms;
#[cfg(test)]
pub(crate) mod population;
pub(crate) mod proposer;
#[cfg(test)]
pub(crate) mod regulator;
pub mod replay;
pub mod ring;
pub mod scaling;
pub mod schedule;
pub mod seat;
pub mod seat_network;
pub mod simplex_regression;
pub mod soft_actor_critic;
pub mod soft_learner;
pub mod state_rule;
