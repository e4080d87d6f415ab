//! Files that the user names: studies, data, curves, runs of other programs.
//!
//! Only regular files are opened: a device has no end, and a pipe may never begin. A file that is larger than usual for
//! its use is not read, unless a larger limit was requested. The limit does not affect results: a file is read
//! completely or refused.

use std::{
    fs::{self, File},
    io::{self, ErrorKind, Read as _, Take},
    path::Path,
    sync::atomic::{AtomicU64, Ordering},
};

/// The variable with the limit in megabytes, which an option of every command also sets.
pub const VARIABLE: &str = "REGIMEN_INPUT_MB";
const MEGABYTE: u64 = 1_000_000;

/// The limit that was requested, in megabytes; 0 for none.
static ASKED_MB: AtomicU64 = AtomicU64::new(0);

/// Use of a file, which decides its largest size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Use {
    /// A study, or a part of one.
    Study,
    /// Text that is kept in memory.
    Text,
    /// Bytes of any kind.
    Bytes,
}

impl Use {
    fn largest_mb(self) -> u64 {
        let usual = match self {
            Self::Study => 10,
            Self::Text => 256,
            Self::Bytes => 16_000,
        };
        asked().unwrap_or(usual)
    }
}

/// Sets the limit in megabytes for files of every use.
pub fn allow(megabytes: u64) {
    ASKED_MB.store(megabytes, Ordering::Relaxed);
}

/// The limit that was requested, in megabytes.
#[must_use]
pub fn asked() -> Option<u64> {
    Some(ASKED_MB.load(Ordering::Relaxed)).filter(|megabytes| *megabytes > 0)
}

/// A file that is read up to a length.
pub type Opened = Take<File>;

/// Opens a file for reading. A file of length 0 is not read: files that the system generates on reading (`/proc`) have
/// this length, and may never end.
///
/// # Errors
/// The file cannot be opened, is no regular file, or is too large; the message gives the remedy.
pub fn open(path: &Path, of: Use) -> io::Result<Opened> {
    let named = fs::metadata(path)?;
    is_regular(named.is_file(), named.is_dir())?;
    let file = File::open(path)?;
    let data = file.metadata()?;
    is_regular(data.is_file(), data.is_dir())?;
    let largest = of.largest_mb() * MEGABYTE;
    if data.len() > largest {
        return Err(too_large(data.len(), of));
    }
    Ok(file.take(if data.len() == 0 { 0 } else { largest + 1 }))
}

/// The bytes of a file.
///
/// # Errors
/// The errors of [`open`], and an error if the file grows meanwhile.
pub fn read(path: &Path, of: Use) -> io::Result<Vec<u8>> {
    rest(open(path, of)?, Vec::new(), of)
}

/// The content of a file, compressed or not, whose first bytes were already read.
///
/// # Errors
/// The file cannot be read, or is too large.
pub fn rest(file: impl io::Read, mut read: Vec<u8>, of: Use) -> io::Result<Vec<u8>> {
    let largest = of.largest_mb() * MEGABYTE;
    file.take((largest + 1).saturating_sub(read.len() as u64))
        .read_to_end(&mut read)?;
    if read.len() as u64 > largest {
        return Err(too_large(read.len() as u64, of));
    }
    Ok(read)
}

fn is_regular(is_file: bool, is_folder: bool) -> io::Result<()> {
    let what = match (is_file, is_folder) {
        (true, _) => return Ok(()),
        (_, true) => "it is a folder",
        _ => "it is a device or a pipe, which has no size",
    };
    let message = format!("{what}: name a regular file");
    Err(io::Error::new(ErrorKind::InvalidInput, message))
}

fn too_large(size: u64, of: Use) -> io::Error {
    let (has, largest) = (size.div_ceil(MEGABYTE), of.largest_mb());
    let message =
        format!("it has {has} MB, and no more than {largest} MB are read: `--input-mb {has}` allows more");
    io::Error::new(ErrorKind::FileTooLarge, message)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_a_folder_and_a_pipe_are_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        assert!(made.unwrap().success());
        for (path, word) in [
            (Path::new("/dev/zero"), "device"),
            (folder.path(), "folder"),
            (&pipe, "pipe"),
        ] {
            let told = read(path, Use::Text).unwrap_err().to_string();
            assert!(
                told.contains(word) && told.contains("name a regular file"),
                "{told}"
            );
        }
    }

    #[test]
    fn what_the_system_makes_as_it_is_read_is_not_waited_for() {
        // It contains the messages of the kernel, and a reader waits for the next one.
        for path in ["/proc/kmsg", "/proc/self/status"].map(Path::new) {
            if let Ok(bytes) = read(path, Use::Text) {
                assert!(bytes.is_empty(), "{}", path.display());
            }
        }
    }

    #[test]
    fn what_is_too_large_is_refused_before_it_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("large");
        File::create(&path).unwrap().set_len(3_000_000_000_000).unwrap();
        for of in [Use::Study, Use::Text, Use::Bytes] {
            let told = open(&path, of).unwrap_err().to_string();
            assert!(
                told.contains("3000000 MB") && told.contains("`--input-mb 3000000`"),
                "{told}"
            );
        }
        fs::write(&path, "all of it").unwrap();
        assert_eq!(read(&path, Use::Study).unwrap(), b"all of it");
    }
}
