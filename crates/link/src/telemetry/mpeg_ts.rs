//! KLV packets of an MPEG transport stream (ITU-T H.222.0), with the times of its video (MISB ST 1402).
//!
//! Streams from a radio link begin anywhere and lose packets, so nothing is expected of tables: metadata are taken from every stream
//! that carries private data or metadata, and are KLV if they hold its key.

use std::collections::HashMap;
use std::io::{self, Read};

/// Bytes of a transport packet.
const PACKET_BYTES: usize = 188;
/// Each packet begins with it.
const SYNC: u8 = 0x47;
/// So many packets in a row tell the format.
const TEST_PACKETS: usize = 4;
/// Bytes before each packet: none, or a time (BDAV, `.m2ts`).
const PREFIX_BYTES: [usize; 2] = [0, 4];
/// `stream_id` of private data and of metadata (H.222.0, table 2-22): asynchronous and synchronous KLV.
const METADATA_IDS: [u8; 2] = [0xbd, 0xfc];
/// `stream_id` of audio and video.
const MEDIA_IDS: std::ops::RangeInclusive<u8> = 0xc0..=0xef;
/// Those of video, from whose beginning frames are counted.
const VIDEO_IDS: std::ops::RangeInclusive<u8> = 0xe0..=0xef;
/// A unit of metadata is not larger, bytes.
const MOST_UNIT_BYTES: usize = 1 << 18;
/// The start of the video is the earliest of so many times: frames are not sent in the order in which they are shown.
const FIRST_TIMES: usize = 64;
/// Times count 90 kHz with 33 bits.
const TICKS_PER_S: f64 = 90_000.0;
const TICKS: i64 = 1 << 33;
/// A longer step of the times in a transport stream is no gap of a link that was lost: its clock was set, and times go on without the
/// step, seconds.
pub const LONGEST_STREAM_GAP_S: u32 = 600;
/// Times of decoding that go back by more than this are those of a sender that began again, or of another recording behind the first.
const LARGEST_STEP_BACK: i64 = 9_000;

/// Metadata of one moment.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Unit {
    /// Seconds from the beginning of the video; `None` in a stream without video or audio.
    pub time_s: Option<f64>,
    /// What holds KLV packets.
    pub bytes: Vec<u8>,
}

/// Bytes before each packet, if this is the beginning of a transport stream.
pub(super) fn prefix_bytes(head: &[u8]) -> Option<usize> {
    PREFIX_BYTES.into_iter().find(|prefix| {
        (0..TEST_PACKETS).all(|packet| {
            let at = packet * (PACKET_BYTES + prefix) + prefix;
            head.get(at) == Some(&SYNC)
        })
    })
}

/// Reads all metadata of a stream.
pub(super) fn units(stream: impl Read, prefix: usize) -> io::Result<Vec<Unit>> {
    let mut packets = Packets {
        stream: io::BufReader::with_capacity(1 << 16, stream),
        record: vec![0; PACKET_BYTES + prefix],
        prefix,
    };
    let mut demultiplexer = Demultiplexer::default();
    while packets.read_next()? {
        let packet = &packets.record[packets.prefix..];
        demultiplexer.take(packet);
    }
    Ok(demultiplexer.finish())
}

/// The packets of a stream; what does not begin with the sync byte is skipped.
struct Packets<R> {
    stream: io::BufReader<R>,
    record: Vec<u8>,
    prefix: usize,
}

impl<R: Read> Packets<R> {
    /// Reads the next packet into `record`; false at the end.
    fn read_next(&mut self) -> io::Result<bool> {
        let mut have = 0;
        loop {
            if !self.fill(have)? {
                return Ok(false);
            }
            if self.record[self.prefix] == SYNC {
                return Ok(true);
            }
            // Go on at the next byte that may begin a packet.
            let after = self.prefix + 1;
            let skip = self.record[after..]
                .iter()
                .position(|&byte| byte == SYNC)
                .map_or(self.record.len() - self.prefix, |at| at + 1);
            self.record.copy_within(skip.., 0);
            have = self.record.len() - skip;
        }
    }

    fn fill(&mut self, mut have: usize) -> io::Result<bool> {
        while have < self.record.len() {
            match self.stream.read(&mut self.record[have..]) {
                Ok(0) => return Ok(false),
                Ok(count) => have += count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(true)
    }
}

/// A unit as it is put together.
struct Partial {
    ticks: Option<i64>,
    /// The last time of audio or video before it.
    media_ticks: Option<i64>,
    /// Bytes that are missing, if the stream states a length.
    missing: Option<usize>,
    bytes: Vec<u8>,
    /// The counter of its last packet.
    counter: u8,
}

#[derive(Default)]
struct Demultiplexer {
    /// By PID.
    partial: HashMap<u16, Partial>,
    complete: Vec<(Option<i64>, Vec<u8>)>,
    /// The first times of video, and of audio.
    first_of_video: Vec<i64>,
    first_of_audio: Vec<i64>,
    media_ticks: Option<i64>,
    /// The first stream of video, and the last time of decoding in it.
    clock: Option<(u16, i64)>,
    /// What is added to times, so that they go on where that clock was set.
    moved: i64,
}

impl Demultiplexer {
    /// Takes in a packet (H.222.0, 2.4.3.2).
    fn take(&mut self, packet: &[u8]) {
        let (is_damaged, begins) = (packet[1] & 0x80 != 0, packet[1] & 0x40 != 0);
        let pid = u16::from_be_bytes([packet[1] & 0x1f, packet[2]]);
        let (has_adaptation, has_payload) = (packet[3] & 0x20 != 0, packet[3] & 0x10 != 0);
        let counter = packet[3] & 0x0f;
        if is_damaged || !has_payload {
            return;
        }
        let start = if has_adaptation {
            5 + usize::from(packet[4])
        } else {
            4
        };
        let Some(payload) = packet.get(start..) else {
            return;
        };
        if begins {
            self.end(pid);
            self.begin(pid, payload, counter);
        } else if let Some(partial) = self.partial.get_mut(&pid) {
            if counter == partial.counter {
                return; // Sent twice.
            }
            if counter != (partial.counter + 1) & 0x0f {
                // A packet is lost: so is the unit.
                self.partial.remove(&pid);
                return;
            }
            partial.counter = counter;
            partial.bytes.extend_from_slice(payload);
            self.end_if_complete(pid);
        }
    }

    /// Begins a unit with its header (H.222.0, 2.4.3.6).
    fn begin(&mut self, pid: u16, payload: &[u8], counter: u8) {
        let Some((&[0, 0, 1, id, high, low, _, flags, header_bytes], rest)) =
            payload.split_first_chunk::<9>()
        else {
            return;
        };
        let header_bytes = usize::from(header_bytes);
        let time_at = |at: usize| Some(ticks(rest.get(at..)?.first_chunk()?));
        let shown = (flags & 0x80 != 0).then(|| time_at(0)).flatten();
        let decoded = (flags & 0xc0 == 0xc0).then(|| time_at(5)).flatten();
        if let (true, Some(decoded)) = (VIDEO_IDS.contains(&id), decoded.or(shown)) {
            self.follow_clock(pid, decoded);
        }
        let ticks = shown.map(|ticks| ticks + self.moved);
        if MEDIA_IDS.contains(&id) {
            self.media_ticks = ticks.or(self.media_ticks);
            let first = if VIDEO_IDS.contains(&id) {
                &mut self.first_of_video
            } else {
                &mut self.first_of_audio
            };
            if first.len() < FIRST_TIMES {
                first.extend(ticks);
            }
            return;
        }
        let Some(bytes) = rest.get(header_bytes..) else {
            return;
        };
        if METADATA_IDS.contains(&id) {
            let length = usize::from(u16::from_be_bytes([high, low]));
            let partial = Partial {
                ticks,
                media_ticks: self.media_ticks,
                missing: (length > 0).then(|| length.saturating_sub(3 + header_bytes)),
                bytes: bytes.to_vec(),
                counter,
            };
            self.partial.insert(pid, partial);
            self.end_if_complete(pid);
        }
    }

    /// Takes in when a frame is decoded, and moves later times where the clock was set, as `ffmpeg` moves those of the frames.
    fn follow_clock(&mut self, pid: u16, decoded: i64) {
        let longest_gap = i64::from(LONGEST_STREAM_GAP_S) * TICKS_PER_S as i64;
        match &mut self.clock {
            Some((video, last)) if *video == pid => {
                let step = since(decoded, *last);
                if !(-LARGEST_STEP_BACK..=longest_gap).contains(&step) {
                    self.moved -= step;
                }
                *last = decoded;
            }
            Some(_) => {}
            None => self.clock = Some((pid, decoded)),
        }
    }

    fn end_if_complete(&mut self, pid: u16) {
        let is_complete = self.partial.get(&pid).is_some_and(|partial| {
            let length = partial.missing.unwrap_or(MOST_UNIT_BYTES);
            partial.bytes.len() >= length.min(MOST_UNIT_BYTES)
        });
        if is_complete {
            self.end(pid);
        }
    }

    fn end(&mut self, pid: u16) {
        if let Some(mut partial) = self.partial.remove(&pid) {
            partial
                .bytes
                .truncate(partial.missing.unwrap_or(MOST_UNIT_BYTES));
            let ticks = partial.ticks.or(partial.media_ticks);
            self.complete.push((ticks, partial.bytes));
        }
    }

    /// All units, with times from the first frame on.
    fn finish(mut self) -> Vec<Unit> {
        let pids: Vec<u16> = self.partial.keys().copied().collect();
        for pid in pids {
            self.end(pid);
        }
        let first = if self.first_of_video.is_empty() {
            &self.first_of_audio
        } else {
            &self.first_of_video
        };
        let any = first.first().copied();
        let earliest = any.map(|any| {
            let later = first.iter().map(|&ticks| since(ticks, any)).min();
            any + later.unwrap_or(0)
        });
        let time = |ticks: Option<i64>| Some(since(ticks?, earliest?) as f64 / TICKS_PER_S);
        self.complete
            .into_iter()
            .map(|(ticks, bytes)| Unit {
                time_s: time(ticks),
                bytes,
            })
            .collect()
    }
}

/// A time of 33 bits with marker bits between them.
fn ticks(bytes: &[u8; 5]) -> i64 {
    let part = |byte: u8, bits: u8| i64::from((byte >> 1) & ((1 << bits) - 1));
    part(bytes[0], 3) << 30
        | i64::from(bytes[1]) << 22
        | part(bytes[2], 7) << 15
        | i64::from(bytes[3]) << 7
        | part(bytes[4], 7)
}

/// The difference of two times, which begin again at 0 after 26.5 hours.
fn since(ticks: i64, earlier: i64) -> i64 {
    (ticks - earlier + TICKS / 2).rem_euclid(TICKS) - TICKS / 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A video with KLV, in which both kinds of metadata streams carry the same packets: `make_transport_stream.py`.
    const STREAM: &[u8] = include_bytes!("../../tests/golden/klv.ts");
    /// Their times as ffmpeg reads them, and their bytes as Python wrote them.
    const GOLDEN: &str = include_str!("../../tests/golden/klv_ts.txt");

    fn golden() -> Vec<(f64, String)> {
        GOLDEN
            .lines()
            .map(|line| {
                let (time, packet) = line.split_once(' ').unwrap();
                (time.parse().unwrap(), packet.to_owned())
            })
            .collect()
    }

    fn hex(bytes: &[u8]) -> String {
        bytes.iter().map(|byte| format!("{byte:02x}")).collect()
    }

    fn read(bytes: &[u8]) -> Vec<Unit> {
        units(bytes, prefix_bytes(bytes).unwrap_or(0)).unwrap()
    }

    #[test]
    fn packets_and_times_are_those_of_ffmpeg() {
        let expected = golden();
        let found = read(STREAM);
        assert_eq!(found.len(), expected.len());
        for (unit, (time_s, packet)) in found.iter().zip(&expected) {
            // Synchronous metadata have a header of five bytes before the packet.
            assert!(hex(&unit.bytes).ends_with(packet.as_str()), "{time_s}");
            assert!((unit.time_s.unwrap() - time_s).abs() < 1e-4, "{time_s}");
        }
    }

    #[test]
    fn a_stream_that_begins_anywhere_and_loses_packets_gives_the_others() {
        let whole = read(STREAM);
        for lost in [3usize, 40, 41] {
            let mut bytes = STREAM.to_vec();
            bytes.drain(lost * PACKET_BYTES..(lost + 1) * PACKET_BYTES);
            let found = read(&bytes);
            assert!(found.len() + 1 >= whole.len(), "{lost}");
        }
        // Noise between packets, and a beginning within one.
        let mut bytes = STREAM[100..].to_vec();
        bytes.splice(88 + 50 * PACKET_BYTES..88 + 50 * PACKET_BYTES, [0x47, 1, 2]);
        let found = read(&bytes);
        assert!(found.len() + 3 >= whole.len(), "{}", found.len());
    }

    #[test]
    fn times_go_on_when_the_counter_begins_again() {
        assert_eq!(since(5, TICKS - 5), 10);
        assert_eq!(since(TICKS - 5, 5), -10);
        // H.222.0, 2.4.3.7: '0010', PTS, marker bits.
        assert_eq!(ticks(&[0x2f, 0xff, 0xff, 0xff, 0xff]), TICKS - 1);
        assert_eq!(ticks(&[0x21, 0x00, 0x05, 0xbf, 0x21]), 90_000);
    }

    #[test]
    fn packets_with_a_time_before_them_are_read() {
        let bytes: Vec<u8> = STREAM
            .chunks_exact(PACKET_BYTES)
            .flat_map(|packet| [&[0, 1, 2, 3], packet].concat())
            .collect();
        assert_eq!(prefix_bytes(&bytes), Some(4));
        assert_eq!(read(&bytes), read(STREAM));
    }

    proptest! {
        #![proptest_config(grimnet_fuzz::config(64))]

        #[test]
        fn altered_streams_are_read(
            changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..40),
            keep in 0.0..1.0f64,
        ) {
            let mut bytes = STREAM.to_vec();
            for (at, value) in changes {
                let at = at.index(bytes.len());
                bytes[at] = value;
            }
            bytes.truncate((bytes.len() as f64 * keep) as usize);
            for prefix in PREFIX_BYTES {
                for unit in units(bytes.as_slice(), prefix).unwrap() {
                    prop_assert!(unit.time_s.is_none_or(f64::is_finite));
                }
            }
        }
    }

    /// A packet with a whole unit of a stream.
    fn packet(pid: u8, id: u8, ticks: i64, body: &[u8]) -> Vec<u8> {
        let time = [
            0x21 | (ticks >> 29 & 0x0e) as u8,
            (ticks >> 22) as u8,
            (ticks >> 14) as u8 | 1,
            (ticks >> 7) as u8,
            (ticks << 1) as u8 | 1,
        ];
        let length = (8 + body.len() as u16).to_be_bytes();
        let header = [SYNC, 0x40, pid, 0x10, 0, 0, 1, id];
        let mut packet = [&header[..], &length, &[0x80, 0x80, 5], &time, body].concat();
        packet.resize(PACKET_BYTES, 0xff);
        packet
    }

    #[test]
    fn times_count_from_the_first_frame_and_not_from_sound_before_it() {
        let bytes = [
            packet(1, 0xc0, 90_000, b"sound"),
            packet(2, 0xe0, 144_000, b"frame"),
            packet(3, 0xfc, 153_000, b"klv"),
            packet(2, 0xe0, 162_000, b"frame"),
        ]
        .concat();
        let found = units(bytes.as_slice(), 0).unwrap();
        assert_eq!(found.len(), 1);
        assert_eq!(
            (found[0].time_s, &found[0].bytes[..]),
            (Some(0.1), &b"klv"[..])
        );
    }

    /// Such as two recordings that were joined, in each of which times begin anew.
    #[test]
    fn times_go_on_where_the_clock_was_set_and_gaps_count() {
        let second = 90_000;
        let at = |ticks: i64| {
            let frame = packet(2, 0xe0, ticks, b"frame");
            [frame, packet(3, 0xfc, ticks, b"klv")].concat()
        };
        let bytes = [
            at(10 * second),
            at(11 * second),
            at(5 * second),
            at(6 * second),
            at(26 * second),
            at(7226 * second),
            at(7227 * second),
        ]
        .concat();
        let found = units(bytes.as_slice(), 0).unwrap();
        let times: Vec<f64> = found.iter().filter_map(|unit| unit.time_s).collect();
        assert_eq!(times, [0.0, 1.0, 1.0, 2.0, 22.0, 22.0, 23.0]);
    }
}
