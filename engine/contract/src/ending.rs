//! Endings of processes.

/// Ending of a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// It exited with this code.
    Code(i32),
    /// It was ended by this signal.
    Signal(i32),
}

/// A signal with its usual name, as in `signal 11 (segmentation fault)`.
#[must_use]
pub fn signal_name(signal: i32) -> String {
    let name = match signal {
        4 => "illegal instruction",
        6 => "abort",
        7 => "bus error",
        8 => "arithmetic fault",
        9 => "kill",
        11 => "segmentation fault",
        15 => "termination",
        24 => "processor time limit",
        25 => "file size limit",
        31 => "bad system call",
        _ => return format!("signal {signal}"),
    };
    format!("signal {signal} ({name})")
}
