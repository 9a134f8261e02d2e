//! Follows a flight over a map: each photo is searched where the track says, and its fix moves the track on.
//!
//! ```no_run
//! use grimnet_flight::{Attitude, Flight, FlightOptions, Input, Known};
//! use grimnet_locate::Localizer;
//! use grimnet_photo::Photo;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let mut flight = Flight::new(Localizer::open("area.grim")?, FlightOptions::default())?;
//! flight.push(Input::Attitude(Attitude { time_s: 0.2, yaw_deg: 92.0, pitch_deg: 4.0, roll_deg: 0.0 }))?;
//! for (number, name) in ["a.jpg", "b.jpg", "c.jpg"].into_iter().enumerate() {
//!     let answer = flight.frame(&Photo::open(name)?, 0.5 * number as f64, &Known::default());
//!     if let Some(point) = answer.point {
//!         println!("{:?} {:?}", point.state, point.estimate);
//!     }
//! }
//! # Ok(())
//! # }
//! ```
//!
//! Telemetry (attitude, height, velocity) goes in with [`Flight::push`], in any order and up to 30 s late. A frame's own metadata
//! give its attitude where no other is known. A frame that is tilted by 15 degrees or more is rectified by its attitude, if the field of
//! view is known.
//!
//! The motion between frames is measured from the keypoints of the searches, and bridges frames without a fix where no velocity
//! comes. It counts over ground that the map shows or that was followed from there on; over water the filter coasts.
//!
//! # What is searched
//! A tracked frame is searched in one small window, with heading and ground resolution from the track, so that it costs one
//! hypothesis. Frames without a fix open the window. Where the position is unknown, lost or uncertain, or after a few frames
//! without a fix, the whole map is searched as well.
//!
//! # Telemetry that is wrong
//! What the fixes contradict again and again is in [`Flight::warnings`]: times, yaw, tilt, height and velocity of another convention.
//! Tilt, height and velocity are then left out, and with a wrong yaw the whole attitude. Velocities are used again once the fixes of a
//! minute or more agree with them, through turns; each time that they are left out again it takes twice as long.
//!
//! # Times
//! Seconds on one clock that photos and telemetry share; a frame's time is that of its exposure. A clock that is set during the flight,
//! back or by minutes ahead, is noticed after a few frames ([`Warning::Clock`]): the track begins again at the new time, on the clock of
//! the frames, and telemetry of another time is refused.

mod between_frames;
mod consistency;
mod exposure;
mod flight;
mod frame;
mod frame_history;
mod frame_search;
mod left_out;
mod position_fix;
mod recent;
mod recorded_attitude;
mod search_plan;
mod warning;
mod whole_map;

pub use consistency::{DelayWarning, HeightWarning, TiltWarning, VelocityWarning, YawWarning};
pub use flight::{Flight, FlightOptions};
pub use frame::{FrameAnswer, FrameTimeMs, Known, Searched};
pub use left_out::LeftOut;
pub use position_fix::position_fix;
pub use warning::{ClockWarning, Warning};

/// What goes into a flight and what comes out of it, as the filter has it.
pub use grimnet_track::{
    Attitude, Estimate, Height, Input, InputError, Miss, OptionsError, PositionFix, PositionOf,
    RelativeMotion, Source, Start, Taken, TrackOptions, TrackPoint, TrackState, Vehicle, Velocity,
};
