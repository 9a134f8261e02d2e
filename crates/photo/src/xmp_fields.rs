//! Reads XMP packets of drones (DJI, Parrot, Pix4D's `Camera` names) into [`Metadata`].
//!
//! Both serialisations of RDF are read: properties as attributes of `rdf:Description`, and as elements in it.

use std::collections::HashMap;

use quick_xml::Reader;
use quick_xml::events::Event;

use crate::metadata::Metadata;

/// Namespaces, recognised by their URI and not by their prefix.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Maker {
    /// `http://www.dji.com/drone-dji/1.0/`
    Dji,
    /// `http://www.parrot.com/drone-parrot/1.0/`
    Parrot,
    /// `http://pix4d.com/camera/1.0` (Parrot Sequoia, senseFly and others).
    Camera,
}

/// One property: maker, local name, text.
type Property = (Maker, String, String);

/// Reads a file's own XMP packets, and of those in its EXIF structure what the packets before them lack.
pub(crate) fn read_into(own: &[Vec<u8>], in_exif: &[Vec<u8>], metadata: &mut Metadata) {
    let mut read = Vec::new();
    for packet in own {
        let properties = properties_of(packet, metadata);
        take_properties(&properties, metadata);
        read.extend(properties);
    }
    for packet in in_exif {
        let mut properties = properties_of(packet, metadata);
        let is_same = |a: &Property, b: &Property| a.0 == b.0 && a.1.eq_ignore_ascii_case(&b.1);
        properties.retain(|new| !read.iter().any(|old| is_same(old, new)));
        take_properties(&properties, metadata);
        read.extend(properties);
    }
}

/// The properties of an XMP packet. A packet that cannot be parsed gives those before the fault, and a note.
fn properties_of(packet: &[u8], metadata: &mut Metadata) -> Vec<Property> {
    let text = String::from_utf8_lossy(packet);
    // Packets are padded with spaces, and a DJI firmware pads with NUL.
    let text = text.trim_matches(|c: char| c == '\0' || c.is_whitespace());
    let (properties, fault) = properties(text);
    if let Some(fault) = fault {
        metadata.note("XMP", fault, "not well-formed; the rest is ignored");
    }
    properties
}

/// Collects the properties of the makers known here.
fn properties(text: &str) -> (Vec<Property>, Option<String>) {
    let mut reader = Reader::from_str(text);
    reader.config_mut().check_end_names = false;
    let mut namespaces = HashMap::from([
        ("drone-dji".to_owned(), Maker::Dji),
        ("drone-parrot".to_owned(), Maker::Parrot),
        ("Camera".to_owned(), Maker::Camera),
    ]);
    let mut properties = Vec::new();
    let mut open: Option<(Maker, String)> = None;
    loop {
        let event = match reader.read_event() {
            Ok(event) => event,
            Err(error) => return (properties, Some(error.to_string())),
        };
        match event {
            Event::Eof => return (properties, None),
            Event::Start(ref start) | Event::Empty(ref start) => {
                // Namespace declarations first: they apply to the other attributes of the element.
                for attribute in start.attributes().with_checks(false).flatten() {
                    if let Some(prefix) = attribute.key.0.strip_prefix("xmlns:")
                        && let Some(maker) = maker_of(&attribute.value)
                    {
                        namespaces.insert(prefix.to_owned(), maker);
                    }
                }
                for attribute in start.attributes().with_checks(false).flatten() {
                    if let Some((maker, name)) = known(&namespaces, attribute.key.0) {
                        properties.push((maker, name, attribute.value.trim().to_owned()));
                    }
                }
                open = match &event {
                    Event::Start(start) => known(&namespaces, start.name().0),
                    _ => None,
                };
            }
            Event::Text(text) => {
                if let Some((maker, name)) = open.take() {
                    properties.push((maker, name, text.trim().to_owned()));
                }
            }
            Event::End(_) => open = None,
            _ => {}
        }
    }
}

fn maker_of(address: &str) -> Option<Maker> {
    let address = address.to_ascii_lowercase();
    if address.contains("dji.com/drone-dji") {
        Some(Maker::Dji)
    } else if address.contains("parrot.com/drone-parrot") {
        Some(Maker::Parrot)
    } else if address.contains("pix4d.com/camera") {
        Some(Maker::Camera)
    } else {
        None
    }
}

fn known(namespaces: &HashMap<String, Maker>, qualified: &str) -> Option<(Maker, String)> {
    let (prefix, name) = qualified.split_once(':')?;
    Some((*namespaces.get(prefix)?, name.to_owned()))
}

/// A number as XMP writers format it: `+12.30`, `12.3`, `123/10`, with spaces around.
fn parse_number(text: &str) -> Option<f64> {
    let text = text.trim();
    if let Some((top, bottom)) = text.split_once('/') {
        return Some(top.trim().parse::<f64>().ok()? / bottom.trim().parse::<f64>().ok()?);
    }
    text.parse().ok()
}

/// Numeric properties; a value that is not a number in its range is left out with a note.
struct Numbers<'a> {
    properties: &'a [Property],
}

impl Numbers<'_> {
    fn within(
        &self,
        maker: Maker,
        name: &str,
        range: std::ops::RangeInclusive<f64>,
        metadata: &mut Metadata,
    ) -> Option<f64> {
        let (_, _, text) = self
            .properties
            .iter()
            .find(|(m, n, _)| *m == maker && n.eq_ignore_ascii_case(name))?;
        match parse_number(text) {
            Some(value) if value.is_finite() && range.contains(&value) => Some(value),
            Some(value) if value.is_finite() => {
                let reason = format!("outside {} to {}", range.start(), range.end());
                metadata.note(&format!("XMP {name}"), text, &reason);
                None
            }
            _ => {
                metadata.note(&format!("XMP {name}"), text, "not a number");
                None
            }
        }
    }
}

/// Pitches under Pix4D's names that are believed, degrees from straight down: aircraft hardly look behind them, and some makers
/// put DJI's numbers under these names, which count from the horizon (-90 straight down).
const PIX4D_PITCH: std::ops::Range<f64> = -30.0..60.0;

/// Angles under Pix4D's names, which turn a camera that looks straight down: 0, 0, 0 is nadir with the picture's top to the
/// north, a pitch of 90 looks at the horizon, and the roll is about the direction of the picture's top (Pix4D, "Yaw, Pitch,
/// Roll and Omega, Phi, Kappa angles").
fn take_pix4d_angles(numbers: &Numbers<'_>, metadata: &mut Metadata) {
    let mut angle = |name| numbers.within(Maker::Camera, name, -360.0..=360.0, metadata);
    let (yaw, pitch, roll) = (angle("Yaw"), angle("Pitch"), angle("Roll"));
    if yaw == Some(0.0) && pitch.unwrap_or(0.0) == 0.0 && roll.unwrap_or(0.0) == 0.0 {
        metadata.note(
            "XMP Camera:Yaw, Camera:Pitch, Camera:Roll",
            "0, 0, 0",
            "all exactly zero, so probably not recorded",
        );
        return;
    }
    metadata.gimbal_yaw_deg = yaw;
    match pitch {
        Some(pitch) if PIX4D_PITCH.contains(&pitch) => {
            metadata.gimbal_pitch_deg = Some(pitch - 90.0);
            metadata.nadir_roll_deg = roll;
        }
        Some(pitch) => metadata.note(
            "XMP Camera:Pitch",
            pitch.to_string(),
            "ambiguous: nadir or horizon, depending on the convention of the manufacturer",
        ),
        None => {}
    }
}

const TURN: std::ops::RangeInclusive<f64> = -360.0..=360.0;
const HEIGHT: std::ops::RangeInclusive<f64> = -20_000.0..=100_000.0;

/// Yaw, pitch and roll of gimbal and aircraft, under the names of DJI and of Parrot.
fn take_angles(numbers: &Numbers<'_>, metadata: &mut Metadata) {
    let makers = [
        (Maker::Dji, "Gimbal", "Flight"),
        (Maker::Parrot, "Camera", "Drone"),
    ];
    for (maker, gimbal, aircraft) in makers {
        let mut angle = |part: &str, axis: &str| {
            numbers.within(maker, &format!("{part}{axis}Degree"), TURN, metadata)
        };
        let gimbal = ["Yaw", "Pitch", "Roll"].map(|axis| angle(gimbal, axis));
        let aircraft = ["Yaw", "Pitch", "Roll"].map(|axis| angle(aircraft, axis));
        let keep = |old: &mut Option<f64>, new: Option<f64>| *old = new.or(*old);
        keep(&mut metadata.gimbal_yaw_deg, gimbal[0]);
        keep(&mut metadata.gimbal_pitch_deg, gimbal[1]);
        keep(&mut metadata.gimbal_roll_deg, gimbal[2]);
        keep(&mut metadata.flight_yaw_deg, aircraft[0]);
        keep(&mut metadata.flight_pitch_deg, aircraft[1]);
        keep(&mut metadata.flight_roll_deg, aircraft[2]);
    }
}

fn take_properties(properties: &[Property], metadata: &mut Metadata) {
    let numbers = Numbers { properties };
    take_angles(&numbers, metadata);
    if metadata.gimbal_yaw_deg.is_none() {
        take_pix4d_angles(&numbers, metadata);
    }
    if let Some(value) = numbers.within(Maker::Dji, "RelativeAltitude", HEIGHT, metadata) {
        metadata.relative_altitude_m = Some(value);
    }
    if metadata.gps_altitude_m.is_none() {
        metadata.gps_altitude_m = numbers.within(Maker::Dji, "AbsoluteAltitude", HEIGHT, metadata);
    }
    if let Some(value) = numbers.within(Maker::Camera, "AboveGroundAltitude", HEIGHT, metadata) {
        metadata.above_ground_m = Some(value);
    }
    if let Some(value) = numbers.within(
        Maker::Dji,
        "CalibratedFocalLength",
        50.0..=200_000.0,
        metadata,
    ) {
        metadata.calibrated_focal_px = Some(value);
    }
    let lat = numbers.within(Maker::Dji, "GpsLatitude", -90.0..=90.0, metadata);
    // `GpsLongtitude` is how several firmwares spell it.
    let lon = numbers
        .within(Maker::Dji, "GpsLongitude", -180.0..=180.0, metadata)
        .or_else(|| numbers.within(Maker::Dji, "GpsLongtitude", -180.0..=180.0, metadata));
    if let (Some(lat), Some(lon)) = (lat, lon) {
        metadata.take_position("XMP GpsLatitude, GpsLongitude", lat, lon);
    }
}
