//! The one integration binary: everything here goes through the real program.

#![expect(
    clippy::disallowed_methods,
    reason = "tests wait for programs and look at the machine that they run on"
)]

mod architecture;
mod asking;
mod book;
mod bounds;
mod bucket;
mod comparing;
mod contracts;
mod crashes;
mod cross_play;
mod datasets;
mod describe;
mod disk;
mod drawings;
mod end_states;
mod experiments;
mod exporting;
mod first_study;
mod folders;
mod fsck;
mod fuzzed;
mod going_on;
mod graph;
mod hyperqueue;
mod identity;
mod imported_logs;
mod importing;
mod life_bound;
mod looks;
mod mending;
mod merging;
mod namespaces;
mod needs;
mod obstacles;
mod offline;
mod other_programs;
mod packing;
mod pages;
mod pictures;
mod pins;
mod plain_output;
mod portable_datasets;
mod portable_policies;
mod program;
mod programs;
mod provenance;
mod python_agents;
mod python_environments;
mod record;
mod recorded;
mod recorded_flights;
mod reports;
mod results;
mod resume;
mod rollout;
mod runs;
mod searches;
mod shrunk;
mod signals;
mod silent;
mod skipped;
mod slurm;
mod ssh;
mod stays_inside;
mod suites;
mod third_party;
mod unchecked;
mod verifying;
mod watching;
mod ways;
mod wheel;
mod whole_lives;
