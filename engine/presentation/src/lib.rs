//! Tables, figures, claims and sentences that a study asks for: held against the names of what its trials record, and
//! built, drawn and written from results.

pub mod answers;
pub mod claim_spec;
pub mod figure;
pub mod kinds;
pub mod names;
pub mod request;
pub mod summary;
pub mod table;
pub mod vocabulary;
