//! Telemetry in CSV.

use std::borrow::Cow;

use csv::{ReaderBuilder, StringRecord};
use grimnet_track::{Attitude, HEIGHT_AGL_RANGE_M, Height, Input, Velocity};

use super::recorded::{Telemetry, TelemetryClock, VELOCITY_SIGMA_M_S};
use crate::time_text::unix_s_from_rfc3339;

/// What may stand between columns.
const SEPARATORS: [u8; 3] = [b',', b';', b'\t'];

const TIME: &str = "time";
const ATTITUDE: [&str; 3] = ["yaw_deg", "pitch_deg", "roll_deg"];
const GIMBAL: [&str; 3] = ["gimbal_yaw_deg", "gimbal_pitch_deg", "gimbal_roll_deg"];
const HEIGHT: [&str; 2] = ["height_agl_m", "altitude_amsl_m"];
const VELOCITY: [&str; 3] = [
    "velocity_east_m_s",
    "velocity_north_m_s",
    "velocity_sigma_m_s",
];

/// The names of the columns that are read, by group.
pub(super) fn names() -> String {
    let groups: [&[&str]; 5] = [&[TIME], &ATTITUDE, &GIMBAL, &HEIGHT, &VELOCITY];
    groups.map(|group| group.join(", ")).join("; ")
}

/// Reads the content of a file.
///
/// # Errors
/// What is wrong with its first line.
pub(super) fn parse(bytes: &[u8]) -> Result<Telemetry, String> {
    let separator = separator(bytes);
    let mut reader = ReaderBuilder::new()
        .delimiter(separator)
        .flexible(true)
        .trim(csv::Trim::All)
        .from_reader(bytes);
    let not_text = |_| {
        format!(
            "neither CSV nor SRT nor MISB KLV: its first line is no text in UTF-8; write a log of an autopilot (.bin, .ulg, .tlog) as CSV, \
             columns that are read: {}",
            names()
        )
    };
    let header = reader.headers().map_err(not_text)?.clone();
    if header.is_empty() {
        return Err("expected a line with the names of columns".to_owned());
    }
    let columns = Columns::of(&header, separator)?;
    let mut telemetry = Telemetry::new(TelemetryClock::Own);
    telemetry.unread_columns = columns.unread(&header);
    // That of the first row that can be read: times of two clocks cannot be put in order.
    let mut clock = None;
    let mut rows = Vec::new();
    let mut record = StringRecord::new();
    loop {
        match reader.read_record(&mut record) {
            Ok(false) => break,
            Ok(true) => {
                let row = columns.row(&record).and_then(|row| {
                    if *clock.get_or_insert(row.clock) == row.clock {
                        Ok(row)
                    } else {
                        Err("seconds and dates are mixed in the column `time`".to_owned())
                    }
                });
                match row {
                    Ok(row) => rows.push(row),
                    Err(problem) => {
                        let line = record.position().map_or(0, csv::Position::line);
                        telemetry.leave_out(|| format!("line {line}: {problem}"));
                    }
                }
            }
            Err(error) => telemetry.leave_out(|| error.to_string()),
        }
    }
    // A gimbal that tells its attitude in some rows is not turned to the aircraft's in the others.
    let has_gimbal = rows.iter().any(|row| row.gimbal.is_some());
    telemetry.attitude_is_of_aircraft = !has_gimbal;
    for row in rows {
        let attitude = if has_gimbal { row.gimbal } else { row.aircraft };
        telemetry.inputs.extend(attitude.map(Input::Attitude));
        telemetry.inputs.extend(row.others);
    }
    telemetry.clock = clock.unwrap_or(TelemetryClock::Own);
    Ok(telemetry.sorted())
}

/// The separator of the first line that is not empty. Spreadsheets of many languages write semicolons, and commas in numbers.
fn separator(bytes: &[u8]) -> u8 {
    let mut lines = bytes.split(|byte| b"\r\n".contains(byte));
    let header = lines.find(|line| !line.is_empty()).unwrap_or_default();
    let mut separators = SEPARATORS.into_iter();
    separators
        .find(|separator| header.contains(separator))
        .unwrap_or(b',')
}

/// What a row says.
struct Row {
    clock: TelemetryClock,
    gimbal: Option<Attitude>,
    /// The attitude of the aircraft, where that of the gimbal is not told.
    aircraft: Option<Attitude>,
    others: Vec<Input>,
}

/// Where each column is.
struct Columns {
    /// Whether numbers may have a comma before their fraction.
    has_decimal_commas: bool,
    time: usize,
    attitude: [Option<usize>; 3],
    gimbal: [Option<usize>; 3],
    height: [Option<usize>; 2],
    velocity: [Option<usize>; 3],
}

impl Columns {
    fn of(header: &StringRecord, separator: u8) -> Result<Self, String> {
        let at = |name: &str| {
            header
                .iter()
                .position(|column| column.trim_start_matches('\u{feff}') == name)
        };
        Ok(Self {
            has_decimal_commas: separator != b',',
            time: at(TIME)
                .ok_or_else(|| format!("no column `{TIME}`; columns that are read: {}", names()))?,
            attitude: ATTITUDE.map(at),
            gimbal: GIMBAL.map(at),
            height: HEIGHT.map(at),
            velocity: VELOCITY.map(at),
        })
    }

    /// The names of the columns that nothing is read from.
    fn unread(&self, header: &StringRecord) -> Vec<String> {
        // Those of a group that are needed, and all of it.
        let groups = [
            (&self.attitude[..], &self.attitude[..]),
            (&self.gimbal[..2], &self.gimbal[..]),
            (&self.height[..1], &self.height[..]),
            (&self.velocity[..2], &self.velocity[..]),
        ];
        let is_read = |column: usize| {
            let is_in_whole_group = groups.iter().any(|(needed, all)| {
                needed.iter().all(Option::is_some) && all.contains(&Some(column))
            });
            column == self.time || is_in_whole_group
        };
        let names = header.iter().enumerate();
        names
            .filter(|(column, name)| !name.is_empty() && !is_read(*column))
            .map(|(_, name)| name.to_owned())
            .collect()
    }

    /// What stands in a column, numbers with a point before their fraction.
    fn cell<'a>(&self, record: &'a StringRecord, column: usize) -> Cow<'a, str> {
        let cell = record.get(column).unwrap_or_default();
        if self.has_decimal_commas && cell.contains(',') {
            cell.replace(',', ".").into()
        } else {
            cell.into()
        }
    }

    fn row(&self, record: &StringRecord) -> Result<Row, String> {
        let text = self.cell(record, self.time);
        let (clock, time_s) = match text.parse::<f64>() {
            Ok(time_s) if time_s.is_finite() => (TelemetryClock::Own, time_s),
            _ => match unix_s_from_rfc3339(&text) {
                Some(time_s) => (TelemetryClock::Unix, time_s),
                None => return Err(format!("{text:?} is no time in seconds or RFC 3339")),
            },
        };
        let numbers = |columns: &[Option<usize>]| -> Result<Vec<Option<f64>>, String> {
            let cell = |column: &Option<usize>| column.map(|column| self.cell(record, column));
            let cells = columns.iter().map(cell);
            cells
                .map(|cell| number(&cell.unwrap_or_default()))
                .collect()
        };
        let (mut gimbal, mut aircraft, mut others) = (None, None, Vec::new());
        if let [Some(yaw), Some(pitch), roll] = numbers(&self.gimbal)?[..] {
            let roll = roll.unwrap_or(0.0);
            gimbal = Some(Attitude::from_gimbal(time_s, yaw, pitch, roll));
        } else if let [Some(yaw_deg), Some(pitch_deg), Some(roll_deg)] =
            numbers(&self.attitude)?[..]
        {
            aircraft = Some(Attitude {
                time_s,
                yaw_deg,
                pitch_deg,
                roll_deg,
            });
        }
        if let [Some(agl_m), amsl_m] = numbers(&self.height)?[..]
            && HEIGHT_AGL_RANGE_M.contains(&agl_m)
        {
            others.push(Input::Height(Height {
                time_s,
                agl_m,
                amsl_m,
            }));
        }
        if let [Some(east_m_s), Some(north_m_s), sigma] = numbers(&self.velocity)?[..] {
            others.push(Input::Velocity(Velocity {
                time_s,
                east_m_s,
                north_m_s,
                sigma_m_s: sigma
                    .filter(|sigma| *sigma > 0.0)
                    .unwrap_or(VELOCITY_SIGMA_M_S),
            }));
        }
        Ok(Row {
            clock,
            gimbal,
            aircraft,
            others,
        })
    }
}

/// A number, nothing for an empty cell and for one that is not a number by its own word: what was not measured, as NumPy writes it.
fn number(cell: &str) -> Result<Option<f64>, String> {
    if cell.is_empty() {
        return Ok(None);
    }
    match cell.parse::<f64>() {
        Ok(value) if value.is_nan() => Ok(None),
        Ok(value) if value.is_finite() => Ok(Some(value)),
        _ => Err(format!("{cell:?} is no number")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_become_inputs() {
        let text = "\u{feff}time, gimbal_yaw_deg,gimbal_pitch_deg,height_agl_m,altitude_amsl_m,velocity_east_m_s,velocity_north_m_s,note\n\
                    2.5,10,-80,100,130,1,2,a\n\
                    1.5,,,101,,,,b\n\
                    bad,,,,,,,\n\
                    3.5,x,,,,,,\n\
                    4.5,,,-1,,,\n";
        let telemetry = parse(text.as_bytes()).unwrap();
        assert_eq!(telemetry.clock, TelemetryClock::Own);
        assert_eq!(telemetry.left_out, 2);
        assert_eq!(telemetry.unread_columns, ["note"]);
        assert_eq!(
            telemetry.first_problem.unwrap(),
            "line 4: \"bad\" is no time in seconds or RFC 3339"
        );
        let [
            Input::Height(first),
            Input::Attitude(attitude),
            Input::Height(second),
            Input::Velocity(velocity),
        ] = telemetry.inputs[..]
        else {
            panic!("{:?}", telemetry.inputs);
        };
        assert_eq!(
            (first.time_s, first.agl_m, first.amsl_m),
            (1.5, 101.0, None)
        );
        assert!((attitude.yaw_deg - 10.0).abs() < 1e-9);
        assert!((attitude.pitch_deg - 10.0).abs() < 1e-9);
        assert_eq!(second.amsl_m, Some(130.0));
        assert_eq!((velocity.east_m_s, velocity.north_m_s), (1.0, 2.0));
    }

    #[test]
    fn what_was_not_measured_is_unknown() {
        let text = "time,height_agl_m,altitude_amsl_m,velocity_east_m_s,velocity_north_m_s\n\
                    1.5,100,nan,NaN,NaN\n\
                    1.6,65535,130,,\n\
                    1.7,0.05,130,,\n\
                    2.5,inf,130,1,2\n";
        let telemetry = parse(text.as_bytes()).unwrap();
        let height = Height {
            time_s: 1.5,
            agl_m: 100.0,
            amsl_m: None,
        };
        assert_eq!(telemetry.inputs, [Input::Height(height)]);
        assert_eq!(telemetry.left_out, 1);
    }

    #[test]
    fn separators_are_commas_semicolons_or_tabs() {
        let with_commas = "time,height_agl_m,velocity_east_m_s,velocity_north_m_s,note\n\
                           1782036000.25,100.5,-1.5,2,a\n";
        let expected = parse(with_commas.as_bytes()).unwrap();
        assert_eq!(expected.inputs.len(), 2);
        let semicolons = with_commas.replace(',', ";");
        for text in [
            with_commas.replace(',', "\t"),
            semicolons.replace('.', ","),
            semicolons,
        ] {
            assert_eq!(parse(text.as_bytes()).as_ref(), Ok(&expected), "{text}");
        }
        let dated = "time;height_agl_m\r\n2026-09-21T14:13:20,25Z;100,5\r\n";
        let telemetry = parse(dated.as_bytes()).unwrap();
        assert_eq!(telemetry.inputs[0].time_s(), 1_790_000_000.25);
    }

    #[test]
    fn columns_of_other_names_and_parts_of_groups_are_told() {
        let unread = |header: &str| parse(header.as_bytes()).unwrap().unread_columns;
        assert_eq!(
            unread("time,height_agl_m,yaw,pitch,roll\n"),
            ["yaw", "pitch", "roll"]
        );
        assert_eq!(
            unread(
                "altitude_amsl_m,time,yaw_deg,roll_deg,gimbal_yaw_deg,gimbal_pitch_deg,velocity_east_m_s\n"
            ),
            [
                "altitude_amsl_m",
                "yaw_deg",
                "roll_deg",
                "velocity_east_m_s"
            ]
        );
        assert!(
            parse(b"Time,height_agl_m\n")
                .unwrap_err()
                .contains("height_agl_m")
        );
    }

    #[test]
    fn rows_of_another_clock_than_the_first_are_left_out() {
        for (rows, clock, time_s) in [
            (
                "5,100\n2026-09-21T14:13:20Z,100\n",
                TelemetryClock::Own,
                5.0,
            ),
            (
                "2026-09-21T14:13:20Z,100\n5,100\n",
                TelemetryClock::Unix,
                1_790_000_000.0,
            ),
        ] {
            let telemetry = parse(format!("time,height_agl_m\n{rows}").as_bytes()).unwrap();
            assert_eq!((telemetry.clock, telemetry.left_out), (clock, 1), "{rows}");
            let times: Vec<f64> = telemetry.inputs.iter().map(Input::time_s).collect();
            assert_eq!(times, [time_s], "{rows}");
            assert!(telemetry.first_problem.unwrap().starts_with("line 3: "));
        }
    }

    #[test]
    fn dates_are_seconds_since_1970() {
        let text = "time,yaw_deg,pitch_deg,roll_deg\n2026-09-21T14:13:20.25Z,1,2,3\n";
        let telemetry = parse(text.as_bytes()).unwrap();
        assert_eq!(telemetry.clock, TelemetryClock::Unix);
        let Input::Attitude(attitude) = telemetry.inputs[0] else {
            panic!("{:?}", telemetry.inputs);
        };
        assert_eq!(attitude.time_s, 1_790_000_000.25);
        assert_eq!(
            (attitude.yaw_deg, attitude.pitch_deg, attitude.roll_deg),
            (1.0, 2.0, 3.0)
        );
    }

    #[test]
    fn rows_without_the_gimbal_do_not_turn_the_camera_to_the_aircraft() {
        let header = "time,yaw_deg,pitch_deg,roll_deg,gimbal_yaw_deg,gimbal_pitch_deg";
        let pitches = |rows: &str| -> Vec<f64> {
            let telemetry = parse(format!("{header}\n{rows}").as_bytes()).unwrap();
            let pitch = |input: &Input| match input {
                Input::Attitude(attitude) => Some(attitude.pitch_deg.round()),
                _ => None,
            };
            telemetry.inputs.iter().filter_map(pitch).collect()
        };
        assert_eq!(pitches("1.0,10,2,1,10,-60\n1.1,10,2,1,,\n"), [30.0]);
        assert_eq!(pitches("1.0,10,2,1,,\n1.1,10,2,1,10,-60\n"), [30.0]);
        // A file whose gimbal tells nothing has the aircraft's attitude.
        assert_eq!(pitches("1.0,10,2,1,,\n1.1,10,3,1,,\n"), [2.0, 3.0]);
    }

    #[test]
    fn a_mount_turns_the_attitude_of_the_aircraft_and_not_that_of_a_gimbal() {
        let yaw_deg = |text: &str| {
            let telemetry = parse(text.as_bytes()).unwrap();
            let mounted = telemetry.mounted("180".parse().unwrap());
            match mounted.inputs[..] {
                [Input::Attitude(attitude)] => attitude.yaw_deg.round(),
                _ => panic!("{:?}", mounted.inputs),
            }
        };
        assert_eq!(
            yaw_deg("time,yaw_deg,pitch_deg,roll_deg\n1,10,0,0\n"),
            190.0
        );
        assert_eq!(
            yaw_deg("time,gimbal_yaw_deg,gimbal_pitch_deg\n1,10,-80\n"),
            10.0
        );
    }
}
