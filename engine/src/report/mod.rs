//! The report of a study: tables, figures, claims and what they rest on.

#[cfg(test)]
pub(crate) mod synthetic;
