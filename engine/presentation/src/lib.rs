//! What a study asks to be shown: tables, figures, claims and sentences, held against the names of what its trials
//! record, and built, drawn and written from results.

pub mod answers;
pub mod catalogue;
pub mod claim_spec;
pub mod figure;
pub mod kinds;
pub mod request;
pub mod summary;
pub mod table;
