//! Tables, figures, claims and sentences of a study: checked against the names that its trials record, built from
//! results, drawn and written.

pub mod answers;
pub mod axis;
pub mod claim_spec;
pub mod figure;
pub mod kinds;
pub mod names;
pub mod request;
pub mod summary;
pub mod table;
pub mod vocabulary;
