//! The subtitles that DJI drones write beside a video.
//!
//! Each model has a dialect of its own; what they have in common is a key before each number. Known are `[rel_alt: 1.2 abs_alt:
//! 3.4]`, `[gb_yaw: 1.0 gb_pitch: -90.0 gb_roll: 0.0]`, `BAROMETER:1.9`, `H 58.20m` and `G.PRY (-90.0°, 0.0°, 172.4°)`. What is
//! bracketed by `<` and `>` is formatting.

use grimnet_track::{Attitude, HEIGHT_AGL_RANGE_M, Height, Input};

use super::recorded::{Telemetry, TelemetryClock};

/// Reads the content of a file.
pub(super) fn parse(text: &str) -> Telemetry {
    let mut telemetry = Telemetry::new(TelemetryClock::Video);
    let mut lines = text.lines().map(str::trim).peekable();
    while let Some(line) = lines.next() {
        let Some((begin, _)) = line.split_once("-->") else {
            continue;
        };
        let mut body = String::new();
        while let Some(next) = lines.next_if(|next| !next.is_empty() && !next.contains("-->")) {
            body.push_str(next);
            body.push(' ');
        }
        match seconds(begin.trim()) {
            Some(time_s) => push_inputs(&without_tags(&body), time_s, &mut telemetry.inputs),
            None => telemetry.leave_out(|| format!("{begin:?} is no time of a subtitle")),
        }
    }
    telemetry.sorted()
}

fn push_inputs(body: &str, time_s: f64, inputs: &mut Vec<Input>) {
    if let Some([yaw, pitch, roll]) = gimbal_yaw_pitch_roll(body) {
        inputs.push(Input::Attitude(Attitude::from_gimbal(
            time_s, yaw, pitch, roll,
        )));
    }
    let height = ["rel_alt", "BAROMETER", "H"]
        .iter()
        .find_map(|key| number_after(body, key));
    if let Some(agl_m) = height.filter(|height| HEIGHT_AGL_RANGE_M.contains(height)) {
        inputs.push(Input::Height(Height {
            time_s,
            agl_m,
            amsl_m: number_after(body, "abs_alt"),
        }));
    }
}

fn gimbal_yaw_pitch_roll(body: &str) -> Option<[f64; 3]> {
    if let (Some(yaw), Some(pitch)) = (number_after(body, "gb_yaw"), number_after(body, "gb_pitch"))
    {
        return Some([yaw, pitch, number_after(body, "gb_roll").unwrap_or(0.0)]);
    }
    let (_, rest) = body.split_once("G.PRY")?;
    let (_, rest) = rest.split_once('(')?;
    let (inside, _) = rest.split_once(')')?;
    let mut numbers = inside.split(',').map(|part| leading_number(part.trim()));
    let [pitch, roll, yaw] = [numbers.next()??, numbers.next()??, numbers.next()??];
    Some([yaw, pitch, roll])
}

/// The number after a key, which stands by itself: after it come spaces or a colon.
fn number_after(text: &str, key: &str) -> Option<f64> {
    let mut from = 0;
    while let Some(at) = text[from..].find(key) {
        let begin = from + at;
        let end = begin + key.len();
        let alone = !text[..begin].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == '.');
        let rest = text[end..].trim_start_matches([' ', ':', '\t']);
        if alone
            && rest.len() < text.len() - end
            && let Some(number) = leading_number(rest)
        {
            return Some(number);
        }
        from = end;
    }
    None
}

/// The number at the beginning of a text.
fn leading_number(text: &str) -> Option<f64> {
    let end = text
        .find(|c: char| !(c.is_ascii_digit() || matches!(c, '+' | '-' | '.')))
        .unwrap_or(text.len());
    text[..end]
        .parse()
        .ok()
        .filter(|number: &f64| number.is_finite())
}

/// Seconds of `HH:MM:SS,mmm`. Up to three digits are milliseconds, as in ffmpeg; more are a decimal fraction (microseconds).
fn seconds(text: &str) -> Option<f64> {
    let (clock, digits) = text.split_once([',', '.'])?;
    let mut parts = clock.split(':').map(|part| part.parse::<u32>().ok());
    let [hours, minutes, seconds] = [parts.next()??, parts.next()??, parts.next()??];
    let is_number = digits.bytes().all(|digit| digit.is_ascii_digit());
    let fraction = f64::from(digits.parse::<u32>().ok().filter(|_| is_number)?);
    let places = i32::try_from(digits.len()).ok()?.max(3);
    Some(
        f64::from(hours) * 3600.0
            + f64::from(minutes) * 60.0
            + f64::from(seconds)
            + fraction / 10f64.powi(places),
    )
}

fn without_tags(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    let mut inside = false;
    for c in text.chars() {
        match c {
            '<' => inside = true,
            '>' if inside => {
                inside = false;
                plain.push(' ');
            }
            _ if !inside => plain.push(c),
            _ => {}
        }
    }
    plain
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each dialect: text, height above take-off, altitude, gimbal's yaw and pitch.
    type Dialect = (&'static str, f64, Option<f64>, Option<(f64, f64)>);

    const DIALECTS: [Dialect; 4] = [
        (
            "<font size=\"28\">FrameCnt: 1, DiffTime: 33ms\n2023-05-01 12:00:00.123\n[iso: 100] [latitude: 24.1] \
             [longitude: 120.6] [rel_alt: 119.500 abs_alt: 150.250] [ct: 5500] [gb_yaw: -20.5 gb_pitch: -89.9 gb_roll: 0.0] </font>",
            119.5,
            Some(150.25),
            Some((339.5, -89.9)),
        ),
        (
            "HOME(149.0251,-20.2532) 2017.08.05 14:11:51\nGPS(149.0251,-20.2533,16) BAROMETER:61.9\nISO:100 Shutter:60 EV: Fnum:F2.2",
            61.9,
            None,
            None,
        ),
        (
            "F/2.8, SS 206.14, ISO 150, EV 0, GPS (-122.3699, 37.8166, 15), D 224.10m, H 58.20m, H.S 15.53m/s, V.S -0.2m/s",
            58.2,
            None,
            None,
        ),
        (
            "F.PRY (1.3°, 2.6°, 172.7°), G.PRY (-80.0°, 0.0°, 172.4°), H 30.0M",
            30.0,
            None,
            Some((172.4, -80.0)),
        ),
    ];

    #[test]
    fn dialects_are_known() {
        for (body, agl_m, amsl_m, gimbal) in DIALECTS {
            let text = format!("7\r\n00:01:02,500 --> 00:01:02,533\r\n{body}\r\n\r\n");
            let telemetry = parse(&text);
            let height = telemetry.inputs.iter().find_map(|input| match input {
                Input::Height(height) => Some(*height),
                _ => None,
            });
            let expected = Height {
                time_s: 62.5,
                agl_m,
                amsl_m,
            };
            assert_eq!(height, Some(expected), "{body}");
            let attitude = telemetry.inputs.iter().find_map(|input| match input {
                Input::Attitude(attitude) => Some(*attitude),
                _ => None,
            });
            assert_eq!(attitude.is_some(), gimbal.is_some(), "{body}");
            if let (Some(found), Some((yaw, pitch))) = (attitude, gimbal) {
                // Without roll the camera's pitch is the gimbal's, from straight down.
                let off_deg = grimnet_geo::turn_deg(yaw, found.yaw_deg);
                assert!(off_deg.abs() < 1e-6, "{found:?}");
                assert!((found.pitch_deg - (pitch + 90.0)).abs() < 1e-6, "{found:?}");
            }
        }
    }

    #[test]
    fn times_have_milliseconds_or_a_longer_fraction() {
        for (text, expected) in [
            ("00:00:01,033", Some(1.033)),
            ("01:02:03.5", Some(3723.005)),
            ("00:00:01,033333", Some(1.033_333)),
            ("00:00:01,+33", None),
            ("00:00:01,", None),
            ("00:01", None),
        ] {
            let found = seconds(text);
            assert_eq!(found.is_some(), expected.is_some(), "{text}");
            let apart = found.zip(expected).map_or(0.0, |(f, e)| f - e);
            assert!(apart.abs() < 1e-9, "{text}: {found:?}");
        }
    }

    #[test]
    fn a_block_without_a_time_is_left_out() {
        let telemetry =
            parse("1\n0:x --> 1\nrel_alt: 5\n\n2\n00:00:01,000 --> 00:00:02,000\nrel_alt: 6\n");
        assert_eq!((telemetry.left_out, telemetry.inputs.len()), (1, 1));
    }
}
