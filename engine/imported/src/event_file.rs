//! Event files as TensorBoard reads them: records of the TFRecord format, each an `Event` in Protocol Buffers.
//!
//! A record is the length of its data (u64, little endian), the masked CRC32C of these eight bytes, the data, and
//! the masked CRC32C of the data (`tensorflow/core/lib/io/record_writer.h`); numbers of fields are those of
//! `tensorboard/compat/proto/event.proto` and `summary.proto`.

use prost::Message;

/// Version of the format, in the first event of a file.
const FILE_VERSION: &str = "brain.Event:2";

/// One event.
#[derive(Clone, PartialEq, Message)]
pub struct Event {
    /// Seconds since 1970, in UTC.
    #[prost(double, tag = "1")]
    pub wall_time: f64,
    /// Step of the training.
    #[prost(int64, tag = "2")]
    pub step: i64,
    /// The form of the file, in its first event.
    #[prost(string, optional, tag = "3")]
    pub file_version: Option<String>,
    /// Values at this step.
    #[prost(message, optional, tag = "5")]
    pub summary: Option<Summary>,
    /// A start or an end of the program.
    #[prost(message, optional, tag = "7")]
    pub session_log: Option<SessionLog>,
}

/// A start or an end of the program that writes.
#[derive(Clone, PartialEq, Message)]
pub struct SessionLog {
    /// 1 for a start.
    #[prost(int32, tag = "1")]
    pub status: i32,
}

impl Event {
    /// Whether the program starts here. A start voids earlier values from this step on.
    pub fn starts(&self) -> bool {
        const START: i32 = 1;
        self.session_log.as_ref().is_some_and(|log| log.status == START)
    }
}

/// Values of one step.
#[derive(Clone, PartialEq, Message)]
pub struct Summary {
    /// Values of the step, each under its tag.
    #[prost(message, repeated, tag = "1")]
    pub value: Vec<Scalar>,
}

/// A value under a name.
#[derive(Clone, PartialEq, Message)]
pub struct Scalar {
    /// Name of the value; the part before a slash groups charts.
    #[prost(string, tag = "1")]
    pub tag: String,
    /// The value, in single precision.
    #[prost(float, optional, tag = "2")]
    pub simple_value: Option<f32>,
    /// The name in files of an older form, whose tensors have no tag.
    #[prost(string, tag = "7")]
    pub node_name: String,
    /// The value as newer programs write it.
    #[prost(message, optional, tag = "8")]
    pub tensor: Option<Tensor>,
}

impl Scalar {
    /// The name under which TensorBoard shows the value.
    pub fn tag(&self) -> &str {
        let is_older = self.tag.is_empty() && self.tensor.is_some();
        if is_older { &self.node_name } else { &self.tag }
    }
}

/// A tensor of `tensor.proto`, with the fields that a single number needs.
#[derive(Clone, PartialEq, Message)]
pub struct Tensor {
    /// The type of its entries, by `types.proto`.
    #[prost(int32, tag = "1")]
    pub dtype: i32,
    /// Lengths along the axes.
    #[prost(message, optional, tag = "2")]
    pub shape: Option<Shape>,
    /// Its bytes, low byte first.
    #[prost(bytes = "vec", tag = "4")]
    pub tensor_content: Vec<u8>,
    /// Its values in single precision.
    #[prost(float, repeated, tag = "5")]
    pub float_val: Vec<f32>,
    /// Its values in double precision.
    #[prost(double, repeated, tag = "6")]
    pub double_val: Vec<f64>,
    /// Its values as whole numbers.
    #[prost(int32, repeated, tag = "7")]
    pub int_val: Vec<i32>,
    /// Its values as long whole numbers.
    #[prost(int64, repeated, tag = "10")]
    pub int64_val: Vec<i64>,
}

/// The lengths of a tensor.
#[derive(Clone, PartialEq, Message)]
pub struct Shape {
    /// One for each axis; empty for a single number.
    #[prost(message, repeated, tag = "2")]
    pub dim: Vec<Length>,
}

/// The length of a tensor along an axis.
#[derive(Clone, PartialEq, Message)]
pub struct Length {
    /// Number of entries along the axis.
    #[prost(int64, tag = "1")]
    pub size: i64,
}

impl Tensor {
    /// Number of entries of the tensor.
    pub fn entries(&self) -> i64 {
        let lengths = self.shape.iter().flat_map(|shape| &shape.dim);
        lengths.fold(1, |entries: i64, length| entries.saturating_mul(length.size))
    }
}

/// The first event of a file.
pub fn first(wall_time: f64) -> Event {
    Event {
        wall_time,
        file_version: Some(FILE_VERSION.into()),
        ..Event::default()
    }
}

/// Adds an event to a file.
pub fn append(event: &Event, file: &mut Vec<u8>) {
    let data = event.encode_to_vec();
    let length = (data.len() as u64).to_le_bytes();
    file.extend(length);
    file.extend(masked_crc(&length).to_le_bytes());
    file.extend(&data);
    file.extend(masked_crc(&data).to_le_bytes());
}

/// Whether some bytes begin with a record.
pub fn begins_record(bytes: &[u8]) -> bool {
    bytes
        .split_at_checked(12)
        .is_some_and(|(head, _)| head[8..] == masked_crc(&head[..8]).to_le_bytes())
}

/// The events of a file, up to an incomplete record at its end.
///
/// # Errors
/// A description of the fault in the file.
pub fn events(file: &[u8]) -> Result<Vec<Event>, String> {
    let (mut events, mut rest) = (Vec::new(), file);
    while let Some((head, behind)) = rest.split_at_checked(12) {
        let at = file.len() - rest.len();
        let whole = |bytes: &[u8], check: &[u8]| check == masked_crc(bytes).to_le_bytes();
        let mut length = [0; 8];
        length.copy_from_slice(&head[..8]);
        if !whole(&length, &head[8..]) {
            return Err(format!(
                "the checksum at byte {at} does not hold: it is no event file, or damaged"
            ));
        }
        let length = usize::try_from(u64::from_le_bytes(length)).unwrap_or(usize::MAX);
        let split = behind.split_at_checked(length);
        let Some((data, (check, behind))) =
            split.and_then(|(data, behind)| Some((data, behind.split_at_checked(4)?)))
        else {
            break;
        };
        if !whole(data, check) {
            return Err(format!(
                "the checksum of the record at byte {at} does not hold: the file is damaged"
            ));
        }
        events.push(
            Event::decode(data).map_err(|error| format!("the record at byte {at} is no event: {error}"))?,
        );
        rest = behind;
    }
    Ok(events)
}

/// A masked checksum, rotated and shifted, so that data which contain checksums can be checked.
fn masked_crc(bytes: &[u8]) -> u32 {
    crc32c::crc32c(bytes).rotate_right(15).wrapping_add(0xa282_ead8)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads a file back.
    fn read(file: &[u8]) -> Vec<Event> {
        events(file).unwrap()
    }

    #[test]
    fn a_torn_end_is_passed_over_and_damage_is_not() {
        let mut file = Vec::new();
        append(&first(0.0), &mut file);
        let whole = file.len();
        append(&first(1.0), &mut file);
        assert_eq!(read(&file[..file.len() - 1]).len(), 1);
        assert_eq!(read(&file[..whole + 5]).len(), 1);
        for byte in [0, whole + 13] {
            let mut damaged = file.clone();
            damaged[byte] ^= 1;
            assert!(events(&damaged).unwrap_err().contains("checksum"));
        }
    }

    /// The check value of CRC-32C (RFC 3720, appendix B.4: 32 bytes of zeros), masked by hand.
    #[test]
    fn checksums_are_those_of_the_format() {
        assert_eq!(crc32c::crc32c(&[0; 32]), 0x8a91_36aa);
        let (low, high) = (0x8a91_36aa_u32 >> 15, 0x8a91_36aa_u32 << 17);
        assert_eq!(masked_crc(&[0; 32]), (low | high).wrapping_add(0xa282_ead8));
    }

    /// The bytes of the first record as TensorFlow writes it for wall time 0: field 3, a text of 13 bytes.
    #[test]
    fn a_file_begins_with_its_version() {
        let mut file = Vec::new();
        append(&first(0.0), &mut file);
        assert_eq!(file[..8], 15_u64.to_le_bytes());
        assert_eq!(file[12..27], *b"\x1a\x0dbrain.Event:2");
        assert_eq!(file.len(), 8 + 4 + 15 + 4);
    }

    #[test]
    fn a_value_of_zero_is_written() {
        let value = Scalar {
            tag: "final/return".into(),
            simple_value: Some(0.0),
            ..Scalar::default()
        };
        let event = Event {
            step: 7,
            summary: Some(Summary { value: vec![value] }),
            ..Event::default()
        };
        let mut file = Vec::new();
        append(&event, &mut file);
        assert_eq!(read(&file), [event]);
    }
}
