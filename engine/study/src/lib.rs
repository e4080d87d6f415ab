//! Studies: from one YAML file to its trials, checked until no name, metric, key or range can be wrong.
//!
//! | file | content |
//! |---|---|
//! | `sections` | types of the sections of a study as they are written |
//! | `json_schema` | the schema of a study with all plugins' parameters, by which sections are checked first |
//! | `written` | named parts and their positions |
//! | `first_texts` | the files of a study, as they were read first |
//! | `include`, `blocks`, `overlay` | other files and common keys, overlaid by the study's own keys |
//! | `path` | dotted paths of sweeps, profiles, overrides and `--set` |
//! | `section` | a key of any other section, set from the command line |
//! | `seeds` | a number of seeds, or looks that are planned |
//! | `settings` | the profile and the options of the command line |
//! | `sweep`, `overrides` | values that vary over the trials |
//! | `search` | searches for the best values of keys, written in the section `tune` |
//! | `config` | defaults, presets, data files: a plugin's complete config |
//! | `part`, `parts` | plugins with their complete configs and origins, and the parts of all points of a sweep |
//! | `checked_sections` | the sections from which cells are made |
//! | `plugin_config` | the config of one plugin in a file of its own |
//! | `editor_schema` | the schema of a study for editors |
//! | `schedule` | the stretches of a schedule that a population finds |
//! | `cell`, `cells` | combinations of environment, agent and setting, and their construction |
//! | `dependencies` | artifacts that cells take from each other, in an order without cycles |
//! | `builds`, `fit` | builds the parts of cells: errors of plugins, metrics of trials |
//! | `cross_play` | plays: agents that meet after they were trained, with their seats |
//! | `imported_runs` | runs of other programs, beside the study's agents |
//! | `quotes` | placeholders for values of the study in its texts |
//! | `search_checks` | checks of searches against the metrics of trials |
//! | `search_overlaps` | checks of searched keys against other sections |
//! | `plan` | the trials of a study, the new ones among them and their time |
//! | `repeats` | samples of a sweep that gave the same setting |
//! | `resolved`, `resolved_yaml` | a study with all defaults written out |
//! | `confirmations` | claims that are tested on fresh seeds |
//! | `relative_path` | relative paths from a folder to a file |
//! | `loading`, `checked_study` | all of these steps in order, and the checked study |

mod blocks;
mod builds;
mod cell;
mod cells;
mod checked_sections;
mod checked_study;
mod config;
mod confirmations;
mod cross_play;
mod dependencies;
mod editor_schema;
mod first_texts;
pub mod fit;
mod imported_runs;
mod include;
mod json_schema;
mod known_agents;
mod loading;
mod overlay;
mod overrides;
mod part;
mod parts;
mod path;
pub mod plan;
mod plugin_config;
mod quotes;
mod relative_path;
mod repeats;
mod resolved;
mod resolved_yaml;
mod schedule;
mod search;
mod search_checks;
mod search_overlaps;
mod section;
mod sections;
mod seeds;
mod settings;
mod sweep;
mod written;

pub use builds::can_learn;
pub use cell::Source;
pub use checked_study::Study;
pub use confirmations::Confirmation;
pub use editor_schema::for_editors;
pub use first_texts::FirstTexts;
pub use json_schema::json_schema;
pub use known_agents::KnownAgents;
pub use loading::{load, load_text, name_in};
pub use plugin_config::{load_config, read_config};
pub use relative_path::{along, name_from, way};
pub use repeats::Repeats;
pub use resolved_yaml::{resolved_yaml, section_yaml};
pub use settings::Options;

#[cfg(test)]
mod tests;
