//! What is said to an autopilot and what is taken from it, without any connection: messages in, messages out.

use std::collections::VecDeque;

use grimnet_track::{Input, TrackPoint, TrackState};
use mavlink::{
    MavHeader,
    dialects::common::{
        COMMAND_ACK_DATA, GIMBAL_DEVICE_ATTITUDE_STATUS_DATA, HEARTBEAT_DATA, MavAutopilot, MavCmd,
        MavMessage, MavModeFlag, MavResult, MavState, MavType, PARAM_VALUE_DATA, TIMESYNC_DATA,
    },
};

use crate::{
    autopilot::{Autopilot, AutopilotKind, Version},
    connection::OWN_COMPONENT,
    describe::describe,
    event::{LinkEvent, NotSending},
    every::Every,
    gate::{Jumps, OwnVelocity, usable},
    messages::{Position, odometry_without_position},
    options::LinkOptions,
    output::Output,
    projection::Projection,
    requests::{Known, QUALITY_PARAMETER, Requests},
    rules::rules_for,
    telemetry::mavlink::MavlinkTelemetry,
    time_sync::TimeSync,
};

/// Without a heartbeat for so long the autopilot counts as gone, seconds.
const SILENT_S: f64 = 5.0;
/// Our system as long as no autopilot is known.
const DEFAULT_SYSTEM: u8 = 1;
/// An autopilot that was asked for its version for so long without an answer does not tell it, seconds.
const VERSION_S: f64 = 3.0;
/// An answer to a request for the autopilot's time before the last so many comes too late to say anything.
const TIME_REQUESTS: usize = 8;
/// If nothing is heard for so long, what would be sent is shown for an assumed autopilot, seconds.
const ASSUME_AFTER_S: f64 = 3.0;

/// The two sides of a conversation with an autopilot.
#[derive(Debug)]
pub(crate) struct Session {
    options: LinkOptions,
    /// Whether the autopilot is asked for telemetry, which changes the rates at which it sends it.
    wants_telemetry: bool,
    began_s: f64,
    autopilot: Option<Autopilot>,
    /// Whether the autopilot is assumed, since none was heard.
    assumed: bool,
    /// Since when this autopilot is known, and when it was heard last.
    known_since_s: f64,
    heard_s: f64,
    silent: bool,
    armed: bool,
    /// Its parameter [`QUALITY_PARAMETER`].
    quality_min: Option<f64>,
    time_sync: TimeSync,
    telemetry: MavlinkTelemetry,
    origin: Option<Projection>,
    requests: Requests,
    heartbeat: Every,
    time_request: Every,
    /// When the last requests for the autopilot's time were sent, as they say it.
    asked_ns: VecDeque<i64>,
    position: Every,
    jumps: Jumps,
    own_velocity: OwnVelocity,
    /// What was said last of sending: the message, or why none.
    said: Option<Result<Output, NotSending>>,
    /// With which result the autopilot refuses positions.
    refused: Option<MavResult>,
    sent: u64,
    outbox: Vec<MavMessage>,
    pub inputs: Vec<Input>,
    pub events: Vec<LinkEvent>,
}

impl Session {
    pub fn new(options: LinkOptions, now_s: f64) -> Self {
        Self {
            telemetry: MavlinkTelemetry::new(options.telemetry, AutopilotKind::Other),
            options,
            wants_telemetry: true,
            began_s: now_s,
            autopilot: None,
            assumed: false,
            known_since_s: now_s,
            heard_s: now_s,
            silent: false,
            armed: false,
            quality_min: None,
            time_sync: TimeSync::default(),
            origin: None,
            requests: Requests::new(),
            heartbeat: Every::seconds(1.0),
            time_request: Every::seconds(0.5),
            asked_ns: VecDeque::new(),
            position: Every::seconds(0.1),
            jumps: Jumps::default(),
            own_velocity: OwnVelocity::default(),
            said: None,
            refused: None,
            sent: 0,
            outbox: Vec::new(),
            inputs: Vec::new(),
            events: Vec::new(),
        }
    }

    /// As [`Session::new`]; the autopilot's telemetry stays as it is.
    pub fn without_telemetry(options: LinkOptions, now_s: f64) -> Self {
        Self {
            wants_telemetry: false,
            ..Self::new(options, now_s)
        }
    }

    /// In the name of which system messages are sent: the autopilot's, whose companion this is.
    pub fn system_id(&self) -> u8 {
        self.autopilot
            .map_or(DEFAULT_SYSTEM, |autopilot| autopilot.system_id)
    }

    /// The autopilot, if it is heard.
    pub fn autopilot(&self) -> Option<Autopilot> {
        self.autopilot.filter(|_| !self.silent)
    }

    /// Whether the autopilot told its version, or does not tell it.
    pub fn is_version_settled(&self, now_s: f64) -> bool {
        let in_vain = self.assumed || now_s - self.known_since_s > VERSION_S;
        self.autopilot
            .is_some_and(|autopilot| autopilot.version.is_some() || in_vain)
    }

    /// How many positions were sent.
    pub fn sent(&self) -> u64 {
        self.sent
    }

    /// The message that carries positions at present.
    pub fn sending(&self) -> Option<Output> {
        self.said.and_then(Result::ok)
    }

    /// Takes in a message.
    pub fn receive(&mut self, header: &MavHeader, message: &MavMessage, now_s: f64) {
        if let MavMessage::HEARTBEAT(heartbeat) = message {
            self.take_heartbeat(header, heartbeat, now_s);
        }
        let Some(autopilot) = self.autopilot else {
            return;
        };
        if header.system_id != u32::from(autopilot.system_id) {
            return;
        }
        // A gimbal reports as another component of the same aircraft.
        let is_own = autopilot.sent(header);
        if !is_own && !matches!(message, MavMessage::GIMBAL_DEVICE_ATTITUDE_STATUS(_)) {
            return;
        }
        self.note_time(message, now_s);
        match message {
            MavMessage::TIMESYNC(data) => self.take_time_sync(data, now_s),
            MavMessage::AUTOPILOT_VERSION(data) => self.take_version(data.flight_sw_version),
            MavMessage::GPS_GLOBAL_ORIGIN(data) => {
                self.origin = Some(Projection {
                    lat_deg: f64::from(data.latitude) * 1e-7,
                    lon_deg: f64::from(data.longitude) * 1e-7,
                    kind: autopilot.kind,
                });
            }
            MavMessage::COMMAND_ACK(data) => self.take_acknowledgement(data),
            MavMessage::PARAM_VALUE(data) => self.take_parameter(data),
            MavMessage::GIMBAL_DEVICE_ATTITUDE_STATUS(data) => {
                self.take_gimbal(header.component_id, is_own, data, now_s);
            }
            _ => {
                let Self {
                    telemetry,
                    time_sync,
                    inputs,
                    ..
                } = self;
                let time_s = |boot_s: f64| time_sync.time_s(boot_s).unwrap_or(now_s).min(now_s);
                telemetry.take(message, now_s, &time_s, inputs);
            }
        }
    }

    /// Takes in the attitude of a gimbal. One that the autopilot reports has the autopilot's clock, any other one its own.
    fn take_gimbal(
        &mut self,
        component_id: u8,
        is_own: bool,
        data: &GIMBAL_DEVICE_ATTITUDE_STATUS_DATA,
        now_s: f64,
    ) {
        let boot_s = f64::from(data.time_boot_ms) * 1e-3;
        let own_time_s = is_own.then(|| self.time_sync.time_s(boot_s).unwrap_or(now_s).min(now_s));
        let before = self.telemetry.gimbal();
        self.telemetry
            .take_gimbal(component_id, data, own_time_s, now_s, &mut self.inputs);
        if let Some(id) = self.telemetry.gimbal().filter(|_| before.is_none()) {
            self.events.push(LinkEvent::Gimbal(id));
        }
    }

    fn take_heartbeat(&mut self, header: &MavHeader, heartbeat: &HEARTBEAT_DATA, now_s: f64) {
        let Some(heard) = Autopilot::from_heartbeat(header, heartbeat) else {
            return;
        };
        if self
            .options
            .system_id
            .is_some_and(|wanted| wanted != heard.system_id)
        {
            return;
        }
        let known = self.autopilot.filter(|_| !self.assumed);
        let same = known
            .is_some_and(|known| (known.system_id, known.kind) == (heard.system_id, heard.kind));
        // A silent autopilot may come back with other software, but positions of one aircraft never go to another one.
        if known.is_some_and(|known| known.system_id != heard.system_id || !(same || self.silent)) {
            return;
        }
        if !same {
            self.autopilot = Some(heard);
            self.assumed = false;
            self.known_since_s = now_s;
            self.began_again();
        }
        if self.silent {
            // It may have started again meanwhile, without an origin.
            self.origin = None;
            self.time_sync.forget_start();
        }
        if !same || self.silent {
            self.requests.again();
            if let Some(autopilot) = self.autopilot {
                self.events.push(LinkEvent::Autopilot(autopilot));
            }
        }
        self.silent = false;
        self.heard_s = now_s;
        self.armed = heartbeat
            .base_mode
            .contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
    }

    /// Forgets what the autopilot said before its clock began.
    fn began_again(&mut self) {
        self.time_sync = TimeSync::default();
        let kind = self
            .autopilot
            .map_or(AutopilotKind::Other, |autopilot| autopilot.kind);
        self.telemetry = MavlinkTelemetry::new(self.options.telemetry, kind);
        self.quality_min = None;
        self.refused = None;
        self.origin = None;
        self.requests = Requests::new();
        self.jumps.interrupt();
    }

    fn note_time(&mut self, message: &MavMessage, now_s: f64) {
        let boot_ms = match message {
            MavMessage::ATTITUDE(data) => data.time_boot_ms,
            MavMessage::ATTITUDE_QUATERNION(data) => data.time_boot_ms,
            MavMessage::GLOBAL_POSITION_INT(data) => data.time_boot_ms,
            MavMessage::LOCAL_POSITION_NED(data) => data.time_boot_ms,
            MavMessage::SYSTEM_TIME(data) => data.time_boot_ms,
            _ => return,
        };
        if self.time_sync.arrival(f64::from(boot_ms) * 1e-3, now_s) {
            let version = self.autopilot.and_then(|autopilot| autopilot.version);
            self.began_again();
            self.time_sync.arrival(f64::from(boot_ms) * 1e-3, now_s);
            if let Some(autopilot) = &mut self.autopilot {
                autopilot.version = version;
            }
            self.events.push(LinkEvent::AutopilotRestarted);
        }
    }

    fn take_time_sync(&mut self, data: &TIMESYNC_DATA, now_s: f64) {
        if data.tc1 == 0 {
            // A request: the answer has our time beside the asker's.
            self.outbox.push(MavMessage::TIMESYNC(TIMESYNC_DATA {
                tc1: nanoseconds(now_s),
                ts1: data.ts1,
                target_system: self.system_id(),
                target_component: self.autopilot.map_or(0, |autopilot| autopilot.component_id),
            }));
        } else if self.asked_ns.contains(&data.ts1) {
            // Routers hand on answers to others, whose clocks are not ours.
            let sent_s = data.ts1 as f64 * 1e-9;
            self.time_sync
                .round_trip(sent_s, now_s, data.tc1 as f64 * 1e-9);
        }
    }

    fn take_version(&mut self, flight_sw_version: u32) {
        let version = Version::from_flight_sw_version(flight_sw_version);
        if let Some(autopilot) = &mut self.autopilot
            && version.is_some()
            && autopilot.version != version
        {
            autopilot.version = version;
            self.events.push(LinkEvent::Autopilot(*autopilot));
        }
    }

    fn take_acknowledgement(&mut self, data: &COMMAND_ACK_DATA) {
        // 0: an autopilot that does not say whom it answers.
        if ![0, OWN_COMPONENT].contains(&data.target_component) {
            return;
        }
        match data.command {
            MavCmd::MAV_CMD_REQUEST_MESSAGE => self.requests.answered(),
            MavCmd::MAV_CMD_EXTERNAL_POSITION_ESTIMATE => self.take_refusal(data.result),
            _ => {}
        }
    }

    /// Tells whether positions are refused when that changes: they are sent, and may be refused, every second.
    fn take_refusal(&mut self, result: MavResult) {
        let refused = Some(result).filter(|result| *result != MavResult::MAV_RESULT_ACCEPTED);
        if refused != std::mem::replace(&mut self.refused, refused) {
            self.events
                .push(refused.map_or(LinkEvent::PositionsAccepted, |result| {
                    LinkEvent::PositionsRefused {
                        result: format!("{result:?}"),
                    }
                }));
        }
    }

    fn take_parameter(&mut self, data: &PARAM_VALUE_DATA) {
        if data.param_id.to_str() == Ok(QUALITY_PARAMETER) {
            self.quality_min = Some(f64::from(data.param_value));
        }
    }

    /// What is to be sent at `now_s`. `point_at` gives the track at a time.
    pub fn poll(
        &mut self,
        now_s: f64,
        point_at: &dyn Fn(f64) -> Option<TrackPoint>,
    ) -> Vec<MavMessage> {
        self.notice_silence(now_s);
        if self.heartbeat.is_due(now_s) {
            self.outbox.push(heartbeat());
        }
        if let Some(autopilot) = self.autopilot() {
            if self.time_request.is_due(now_s) {
                let asked_ns = nanoseconds(now_s);
                self.asked_ns.push_back(asked_ns);
                if self.asked_ns.len() > TIME_REQUESTS {
                    self.asked_ns.pop_front();
                }
                self.outbox.push(MavMessage::TIMESYNC(TIMESYNC_DATA {
                    tc1: 0,
                    ts1: asked_ns,
                    target_system: autopilot.system_id,
                    target_component: autopilot.component_id,
                }));
            }
            let known = Known {
                without_telemetry: !self.wants_telemetry,
                origin: self.origin.is_some(),
                quality_min: self.quality_min.is_some() || !self.reads_quality(&autopilot),
            };
            self.requests
                .poll(&autopilot, known, now_s, &mut self.outbox);
        }
        self.poll_position(now_s, point_at);
        let messages = std::mem::take(&mut self.outbox);
        if self.options.dry_run {
            let shown = messages.iter().filter_map(describe);
            self.events.extend(shown.map(LinkEvent::WouldSend));
            return Vec::new();
        }
        messages
    }

    fn notice_silence(&mut self, now_s: f64) {
        let for_s = now_s - self.heard_s;
        if self.autopilot.is_some() && !self.silent && for_s > SILENT_S && !self.options.dry_run {
            self.silent = true;
            self.events.push(LinkEvent::AutopilotSilent { for_s });
        }
        if self.options.dry_run && self.autopilot.is_none() && now_s - self.began_s > ASSUME_AFTER_S
        {
            let assumed = Autopilot {
                system_id: self.options.system_id.unwrap_or(DEFAULT_SYSTEM),
                component_id: 1,
                kind: match self.options.output {
                    Some(Output::GlobalPositionSensor) => AutopilotKind::Px4,
                    _ => AutopilotKind::ArduPilot,
                },
                version: None,
            };
            self.autopilot = Some(assumed);
            self.assumed = true;
            self.events.push(LinkEvent::AutopilotAssumed(assumed));
        }
    }

    fn poll_position(&mut self, now_s: f64, point_at: &dyn Fn(f64) -> Option<TrackPoint>) {
        if !self.position.is_due(now_s) {
            return;
        }
        let result = self.next_position(now_s, point_at);
        if result.is_err() {
            self.jumps.interrupt();
            self.tell_no_position(now_s);
        }
        if self.said != Some(result) {
            self.said = Some(result);
            self.events.push(match result {
                Ok(output) if self.is_of_unknown_software() => LinkEvent::SendingToUnknown(output),
                Ok(output) => LinkEvent::Sending(output),
                Err(reason) => LinkEvent::NotSending(reason),
            });
        }
    }

    /// The message that carries positions to an autopilot.
    fn output(&self, autopilot: &Autopilot) -> Output {
        self.options
            .output
            .unwrap_or_else(|| Output::for_autopilot(autopilot))
    }

    fn is_of_unknown_software(&self) -> bool {
        let kind = self.autopilot.map(|autopilot| autopilot.kind);
        kind == Some(AutopilotKind::Other)
    }

    /// Whether the autopilot compares the quality in the message with [`QUALITY_PARAMETER`], if it has that parameter.
    fn reads_quality(&self, autopilot: &Autopilot) -> bool {
        autopilot.kind == AutopilotKind::ArduPilot && self.output(autopilot) == Output::Odometry
    }

    /// Tells a disarmed ArduPilot that there is no position: while it hears nothing it refuses to be armed (`VisOdom: not
    /// healthy`), whatever its source of positions. On the ground a camera sees no position yet.
    ///
    /// Only one with [`QUALITY_PARAMETER`] at 0 or more is told: any other one would take the message for a position at the origin.
    /// In flight nothing is sent, so that the autopilot shows that the source is gone.
    fn tell_no_position(&mut self, now_s: f64) {
        let is_safe = self.quality_min.is_some_and(|least| least >= 0.0);
        if let Some(autopilot) = self.autopilot()
            && self.reads_quality(&autopilot)
            && is_safe
            && !self.armed
        {
            let own = self.telemetry.own_state(now_s);
            self.outbox
                .push(MavMessage::ODOMETRY(odometry_without_position(now_s, &own)));
        }
    }

    /// Puts the position at `now_s` in the outbox.
    fn next_position(
        &mut self,
        now_s: f64,
        point_at: &dyn Fn(f64) -> Option<TrackPoint>,
    ) -> Result<Output, NotSending> {
        let (state, estimate) = usable(point_at(now_s).as_ref(), self.options.max_radius95_m)?;
        let autopilot = self.autopilot().ok_or(NotSending::NoAutopilot)?;
        if !self.is_version_settled(now_s) {
            return Err(NotSending::NoVersion);
        }
        let output = self.output(&autopilot);
        if let (Some(reason), _) = rules_for(&autopilot, output)
            && !self.is_of_unknown_software()
        {
            return Err(NotSending::NotRead(reason));
        }
        // It replaces the autopilot's position, however uncertain it is; the others are weighed by their variance.
        if output == Output::PositionEstimate && state != TrackState::Tracking {
            return Err(NotSending::NoRecentFix);
        }
        if self.own_velocity.is_sent_back(state, &estimate) {
            return Err(NotSending::OwnVelocity);
        }
        self.position
            .set_seconds(1.0 / output.rate_hz(autopilot.kind));
        let position = Position {
            time_s: now_s,
            state,
            estimate,
            own: self.telemetry.own_state(now_s),
        };
        let message = match output {
            Output::Odometry => {
                let origin = self.origin_for(&position, &autopilot)?;
                let jumps = self.jumps.count(now_s, state, &estimate);
                MavMessage::ODOMETRY(position.odometry(&autopilot, &origin, jumps))
            }
            Output::GlobalPositionSensor => {
                MavMessage::GLOBAL_POSITION_SENSOR(position.global_position_sensor(&autopilot))
            }
            Output::PositionEstimate => {
                MavMessage::COMMAND_INT(position.position_estimate(&autopilot))
            }
            Output::GpsInput => MavMessage::GPS_INPUT(position.gps_input(self.options.gps_id)),
        };
        self.outbox.push(message);
        self.sent += 1;
        Ok(output)
    }

    /// The origin of the autopilot's metres; one that never had a position is told this one.
    fn origin_for(
        &mut self,
        position: &Position,
        autopilot: &Autopilot,
    ) -> Result<Projection, NotSending> {
        if let Some(origin) = self.origin {
            return Ok(origin);
        }
        let here = Projection {
            lat_deg: position.estimate.lat_deg,
            lon_deg: position.estimate.lon_deg,
            kind: autopilot.kind,
        };
        if self.options.dry_run {
            self.origin = Some(here);
            return Ok(here);
        }
        let may_set = self.options.set_origin && position.state == TrackState::Tracking;
        if may_set
            && self
                .requests
                .set_origin(autopilot, position, &mut self.outbox)
        {
            self.events.push(LinkEvent::OriginSet {
                lat_deg: here.lat_deg,
                lon_deg: here.lon_deg,
            });
        }
        Err(NotSending::NoOrigin)
    }
}

/// We are an onboard computer.
fn heartbeat() -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    })
}

fn nanoseconds(time_s: f64) -> i64 {
    (time_s * 1e9) as i64
}
