//! Event files as TensorBoard reads them: records of the TFRecord format, each an `Event` in Protocol Buffers.
//!
//! A record is the length of its data (u64, little endian), the masked CRC32C of these eight bytes, the data, and
//! the masked CRC32C of the data (`tensorflow/core/lib/io/record_writer.h`); numbers of fields are those of
//! `tensorboard/compat/proto/event.proto` and `summary.proto`.

use prost::Message;

/// What the first event says of the form of the file.
const FILE_VERSION: &str = "brain.Event:2";

/// One event.
#[derive(Clone, PartialEq, Message)]
pub(super) struct Event {
    /// Seconds since 1970.
    #[prost(double, tag = "1")]
    pub(super) wall_time: f64,
    /// Step of training.
    #[prost(int64, tag = "2")]
    pub(super) step: i64,
    /// The form of the file, in its first event.
    #[prost(string, optional, tag = "3")]
    pub(super) file_version: Option<String>,
    /// Values.
    #[prost(message, optional, tag = "5")]
    pub(super) summary: Option<Summary>,
}

/// Values of one step.
#[derive(Clone, PartialEq, Message)]
pub(super) struct Summary {
    /// The values.
    #[prost(message, repeated, tag = "1")]
    pub(super) value: Vec<Scalar>,
}

/// A value under a name.
#[derive(Clone, PartialEq, Message)]
pub(super) struct Scalar {
    /// The name; what stands before a slash groups charts.
    #[prost(string, tag = "1")]
    pub(super) tag: String,
    /// The value, in single precision.
    #[prost(float, optional, tag = "2")]
    pub(super) simple_value: Option<f32>,
}

/// The event that a file begins with.
pub(super) fn first(wall_time: f64) -> Event {
    Event {
        wall_time,
        file_version: Some(FILE_VERSION.into()),
        ..Event::default()
    }
}

/// Adds an event to a file.
pub(super) fn append(event: &Event, file: &mut Vec<u8>) {
    let data = event.encode_to_vec();
    let length = (data.len() as u64).to_le_bytes();
    file.extend(length);
    file.extend(masked_crc(&length).to_le_bytes());
    file.extend(&data);
    file.extend(masked_crc(&data).to_le_bytes());
}

/// A checksum of data that may hold checksums: rotated and moved, so that it is no CRC of itself.
fn masked_crc(bytes: &[u8]) -> u32 {
    crc32c::crc32c(bytes).rotate_right(15).wrapping_add(0xa282_ead8)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Reads a file back; panics where a checksum does not hold.
    pub(in crate::export) fn read(mut file: &[u8]) -> Vec<Event> {
        let mut events = Vec::new();
        while !file.is_empty() {
            let (head, rest) = file.split_at(12);
            let length = u64::from_le_bytes(head[..8].try_into().unwrap());
            assert_eq!(head[8..], masked_crc(&head[..8]).to_le_bytes());
            let (data, rest) = rest.split_at(usize::try_from(length).unwrap());
            let (check, rest) = rest.split_at(4);
            assert_eq!(check, masked_crc(data).to_le_bytes());
            events.push(Event::decode(data).unwrap());
            file = rest;
        }
        events
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
