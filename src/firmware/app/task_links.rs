//! Channels, signals and latest values that connect the tasks.

use core::cell::Cell;
use core::sync::atomic::{AtomicU32, Ordering};

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::{self, RawMutex as _};
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;
use embassy_sync::watch::{Receiver, Watch};
use embassy_time::{Duration, Instant};

use crate::health::{CanState, EventCounters, EventCounts};
use autoswing::attitude::{AttitudeReport, LineSelector};
use autoswing::calibration::Sample;
use autoswing::earth::{Date, Position};
use autoswing::inertial::{InertialAttitude, SensorOffsets};
use autoswing::instrument::{Correction, Estimate};
use autoswing::reading::{Identity, Reading};
use autoswing::time::Timestamp;
use autoswing_module::compass::{AutopilotAction, Command, IndicatorState, Reply};
use autoswing_module::messages::{AutopilotReport, Message, Refusal};
use autoswing_module::settings::Settings;
use autoswing_module::settings::{PORT_COUNT, PortNumber, ProtocolKind};

/// Pause after a line error, one or two bytes long, so that a permanent error does not occupy the processor.
pub(super) const LINE_ERROR_PAUSE: Duration = Duration::from_micros(200);

/// Value with the time at which it was ready.
#[derive(Clone, Copy, Debug)]
pub(super) struct Timestamped<T> {
    pub timestamp: Timestamp,
    pub value: T,
}

/// Attitude for the instrument.
#[derive(Clone, Copy, Debug)]
pub(super) enum AttitudeInput {
    /// Report of an autopilot, received at its time.
    Report(AttitudeReport),
    /// Estimate of the own gyro and accelerometer, measured at its time.
    Own(InertialAttitude),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SensorDetection {
    pub identity: Identity,
    pub period_us: u32,
    /// Number of equal readings on an axis that indicate that it is stuck.
    pub equal_readings_until_stuck: u16,
}

/// Source of a command, which receives its reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CommandSource {
    Console,
    Line(AutopilotLine),
    /// The board's button, without a reply; the lamp shows the state.
    Button,
}

/// Line to an autopilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum AutopilotLine {
    Port(PortNumber),
    /// CAN bus, with a tunnelled serial line.
    Can,
}

/// Number of lines.
const LINE_COUNT: usize = PORT_COUNT + 1;

impl AutopilotLine {
    /// All lines.
    pub const ALL_LINES: [Self; LINE_COUNT] = [Self::Port(PortNumber::One), Self::Port(PortNumber::Two), Self::Can];

    const fn line_number(self) -> u8 {
        match self {
            Self::Port(number) => number as u8,
            Self::Can => PORT_COUNT as u8,
        }
    }
}

/// Keeps tasks of two priorities apart.
#[cfg(target_os = "none")]
type TaskMutex = raw::CriticalSectionRawMutex;
/// Simulated tasks share one thread.
#[cfg(not(target_os = "none"))]
type TaskMutex = raw::NoopRawMutex;

/// Channel whose sender never waits: an item that finds it full is counted and dropped.
pub(super) type TaskQueue<T, const N: usize> = Channel<TaskMutex, T, N>;

/// Latest value for up to `N` waiting tasks.
pub(super) type LatestValue<T, const N: usize> = Watch<TaskMutex, T, N>;

pub(super) type ValueReceiver<'a, T, const N: usize> = Receiver<'a, TaskMutex, T, N>;

/// All connections between tasks. The tasks run at two priorities, so each access is a critical section of a few
/// hundred instructions at most.
pub struct TaskLinks {
    pub(super) readings: TaskQueue<Timestamped<Reading>, 4>,
    pub(super) attitude_inputs: TaskQueue<Timestamped<AttitudeInput>, 8>,
    pub(super) samples: TaskQueue<Sample, 8>,
    /// Commands for the state machine. Capacity: one command of each source.
    pub(super) commands: TaskQueue<(CommandSource, Command), { 2 + LINE_COUNT }>,
    /// Replies to commands of the console.
    pub(super) replies: TaskQueue<Result<Reply, Refusal>, 1>,
    /// Unsolicited messages for the console. Each line has a queue of its own.
    pub(super) console_messages: TaskQueue<Message, MESSAGE_QUEUE_CAPACITY>,
    /// Indicator state for the lamp, whose task polls it.
    pub(super) indicator_state: LatestValue<IndicatorState, 1>,
    /// Detected sensor, for the instrument and the state machine.
    pub(super) sensor: LatestValue<SensorDetection, 2>,
    /// Whether the autopilot is armed, if known; for the state machine.
    pub(super) armed_state: LatestValue<Option<bool>, 1>,
    /// The autopilot's position, for the state machine. The date is separate, because it may arrive on another port.
    pub(super) position: LatestValue<Timestamped<Position>, 1>,
    /// Date, for the state machine.
    pub(super) date: LatestValue<Date, 1>,
    /// Motor current, amperes; the instrument polls it.
    pub(super) motor_current: LatestValue<Timestamped<f32>, 0>,
    /// Speed over ground, m/s; the task of gyro and accelerometer polls it.
    pub(super) ground_speed: LatestValue<Timestamped<f32>, 0>,
    /// Offsets of gyro and accelerometer, stored ones at the start; the state machine's task polls the estimated ones.
    pub(super) sensor_offsets: LatestValue<SensorOffsets, 0>,
    /// Correction for the instrument, replaced as a whole, so that a heading never mixes two calibrations.
    pub(super) correction: LatestValue<Correction, 1>,
    /// Effective settings, for the lines.
    pub(super) settings: LatestValue<Settings, LINE_COUNT>,
    /// Settings as stored; the task of the CAN bus polls them.
    pub(super) stored_settings: LatestValue<Settings, 0>,
    /// Latest estimate, for the lines; the console polls it.
    pub(super) estimates: LatestValue<Estimate, LINE_COUNT>,
    /// Request to restart the module, for the console, which does so.
    pub(super) restart_request: Signal<TaskMutex, ()>,
    lines: [LineLinks; LINE_COUNT],
    /// Action on the autopilot of a line, which polls it.
    autopilot_action: Mutex<TaskMutex, Cell<Option<(AutopilotLine, AutopilotAction)>>>,
    attitude_line_selector: Mutex<TaskMutex, Cell<LineSelector>>,
    can_state: Mutex<TaskMutex, Cell<Option<CanState>>>,
    pub(super) event_counters: EventCounters,
    pub(super) heartbeats: Heartbeats,
}

impl TaskLinks {
    /// Creates empty connections.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            readings: Channel::new(),
            attitude_inputs: Channel::new(),
            samples: Channel::new(),
            commands: Channel::new(),
            replies: Channel::new(),
            console_messages: Channel::new(),
            indicator_state: Watch::new(),
            sensor: Watch::new(),
            armed_state: Watch::new(),
            position: Watch::new(),
            date: Watch::new(),
            motor_current: Watch::new(),
            ground_speed: Watch::new(),
            sensor_offsets: Watch::new(),
            correction: Watch::new(),
            settings: Watch::new(),
            stored_settings: Watch::new(),
            estimates: Watch::new(),
            restart_request: Signal::new(),
            lines: [const { LineLinks::new() }; LINE_COUNT],
            autopilot_action: Mutex::new(Cell::new(None)),
            attitude_line_selector: Mutex::new(Cell::new(LineSelector::new())),
            can_state: Mutex::new(Cell::new(None)),
            event_counters: EventCounters::new(),
            heartbeats: Heartbeats::new(),
        }
    }

    pub(super) const fn links_of_line(&self, line: AutopilotLine) -> &LineLinks {
        let [one, two, can] = &self.lines;
        match line {
            AutopilotLine::Port(PortNumber::One) => one,
            AutopilotLine::Port(PortNumber::Two) => two,
            AutopilotLine::Can => can,
        }
    }

    /// Whether an attitude report from a line is accepted, with a gyro's rates or without: one line is selected at a
    /// time.
    pub(super) fn accept_attitude(&self, line: AutopilotLine, at: Timestamp, has_gyro: bool) -> bool {
        self.attitude_line_selector.lock(|selector| {
            let mut line_selector = selector.get();
            let is_accepted = line_selector.accept_line_report(at, line.line_number(), has_gyro);
            selector.set(line_selector);
            is_accepted
        })
    }

    /// Publishes the state of the node on a CAN bus.
    pub(super) fn set_can_state(&self, line_state: CanState) {
        self.can_state.lock(|present| present.set(Some(line_state)));
    }

    /// State of the node on a CAN bus; `None` until it runs.
    pub(super) fn can_state(&self) -> Option<CanState> {
        self.can_state.lock(Cell::get)
    }

    /// Publishes a position, also an unchanged one once a second: repeated ones confirm it.
    pub(super) fn update_position(&self, at: Timestamp, value: Position) {
        let is_known =
            |published: Timestamped<Position>| published.value == value && at.us_since(published.timestamp) < 1_000_000;
        if !self.position.try_get().is_some_and(is_known) {
            self.position.sender().send(Timestamped { timestamp: at, value });
        }
    }

    /// Publishes a line's protocol and armed state.
    pub(super) fn update_line_state(&self, line: AutopilotLine, protocol: ProtocolKind, is_armed: Option<bool>) {
        self.links_of_line(line).state.lock(|state| state.set(LineState { protocol, is_armed }));
        publish_value(&self.armed_state, self.is_armed());
    }

    /// Whether the autopilot of any line is armed, if known.
    pub(super) fn is_armed(&self) -> Option<bool> {
        let armed_states = AutopilotLine::ALL_LINES
            .into_iter()
            .filter_map(|line| self.links_of_line(line).state.lock(Cell::get).is_armed);
        armed_states.reduce(|first, second| first || second)
    }

    /// Passes a line's command to the state machine. If the queue is full, the request times out, and its sender repeats
    /// it.
    pub(super) fn send_command(&self, line: AutopilotLine, command: Option<Command>) {
        if let Some(command) = command {
            let _ = self.commands.try_send((CommandSource::Line(line), command));
        }
    }

    /// Replies to the source of a command.
    pub(super) fn send_reply(&self, source: CommandSource, command: Command, reply: Result<Reply, Refusal>) {
        match source {
            // There is room: the console waits for each reply.
            CommandSource::Console => drop(self.replies.try_send(reply)),
            CommandSource::Line(line) => {
                self.links_of_line(line).command_results.signal((command, reply.map(|_| ())));
            }
            CommandSource::Button => {}
        }
    }

    /// Lines whose autopilot is known by a protocol.
    pub(super) fn lines_with_autopilot(&self, by: ProtocolKind) -> impl Iterator<Item = AutopilotLine> {
        AutopilotLine::ALL_LINES.into_iter().filter(move |line| {
            let LineState { protocol, is_armed } = self.links_of_line(*line).state.lock(Cell::get);
            protocol == by && is_armed.is_some()
        })
    }

    /// Passes an action to the first line whose autopilot is known by MAVLink, or else by MSP.
    pub(super) fn pass_autopilot_action(&self, action: AutopilotAction) {
        let msp_lines = self.lines_with_autopilot(ProtocolKind::Msp);
        match self.lines_with_autopilot(ProtocolKind::Mavlink).chain(msp_lines).next() {
            Some(line) => self.autopilot_action.lock(|pending| pending.set(Some((line, action)))),
            None => self.broadcast_message(&Message::Autopilot(AutopilotReport::NoAutopilot)),
        }
    }

    /// Takes the action on the autopilot of a line.
    pub(super) fn take_autopilot_action(&self, line: AutopilotLine) -> Option<AutopilotAction> {
        self.autopilot_action.lock(|pending| {
            let (_, action) = pending.get().filter(|(addressee, _)| *addressee == line)?;
            pending.set(None);
            Some(action)
        })
    }

    /// Sets the ports' initial protocols to those detected before the restart.
    pub(super) fn set_initial_protocols(&self, detected: [ProtocolKind; PORT_COUNT]) {
        for (port, detected) in PortNumber::ALL_PORTS.into_iter().zip(detected) {
            self.links_of_line(AutopilotLine::Port(port))
                .state
                .lock(|state| state.set(LineState { protocol: detected, ..state.get() }));
        }
    }

    /// Protocols of the ports; the initial ones until a port runs.
    pub(super) fn port_protocols(&self) -> [ProtocolKind; PORT_COUNT] {
        PortNumber::ALL_PORTS.map(|port| self.links_of_line(AutopilotLine::Port(port)).state.lock(Cell::get).protocol)
    }

    /// Present counter values.
    #[must_use]
    pub fn event_counts(&self) -> EventCounts {
        self.event_counters.snapshot()
    }

    /// Sends a message to the console and to the lines.
    pub(super) fn broadcast_message(&self, message: &Message) {
        for queue in self.lines.iter().map(|line| &line.messages).chain([&self.console_messages]) {
            if queue.is_full() {
                let _ = queue.try_receive();
            }
            let _ = queue.try_send(message.clone());
        }
    }

    /// Queues an item; counts it as dropped if the queue is full.
    pub(super) fn queue_or_count<T, const N: usize>(&self, queue: &TaskQueue<T, N>, item: T) {
        if queue.try_send(item).is_err() {
            increment_counter(&self.event_counters.samples_dropped);
        }
    }
}

impl Default for TaskLinks {
    fn default() -> Self {
        Self::new()
    }
}

pub(super) fn now() -> Timestamp {
    Timestamp::from_us(Instant::now().as_micros())
}

/// Creates a task's receiver of a latest value.
///
/// # Panics
///
/// At the start of the firmware, if a board runs more tasks than the value has receivers: a mistake in its task list.
pub(super) fn subscribe<T: Clone, const N: usize>(latest_value: &LatestValue<T, N>) -> ValueReceiver<'_, T, N> {
    latest_value.receiver().expect("an end of the wire for each task that a board runs")
}

/// Publishes a value if it differs from the last, so that no task wakes needlessly.
pub(super) fn publish_value<T: Clone + PartialEq, const N: usize>(latest_value: &LatestValue<T, N>, value: T) {
    if latest_value.try_get().as_ref() != Some(&value) {
        latest_value.sender().send(value);
    }
}

/// Applies a change that no other task sees half done, whatever its priority.
pub(super) fn apply_atomically(change: impl FnOnce()) {
    TaskMutex::new().lock(change);
}

/// Increments a counter; wraps at 2^32.
pub(super) fn increment_counter(counter: &AtomicU32) {
    counter.fetch_add(1, Ordering::Relaxed);
}

/// Capacity of a message queue; a full one drops its oldest message.
const MESSAGE_QUEUE_CAPACITY: usize = 3;

/// State that a line reports.
#[derive(Clone, Copy)]
struct LineState {
    /// Protocol of the line; `Auto` during detection.
    protocol: ProtocolKind,
    /// Whether the line's autopilot is armed, if known.
    is_armed: Option<bool>,
}

pub(super) struct LineLinks {
    /// Heartbeat counter; 0 for a line that does not run.
    pub heartbeat: AtomicU32,
    /// Unsolicited messages for the line.
    pub messages: TaskQueue<Message, MESSAGE_QUEUE_CAPACITY>,
    /// Result of a command received on this line.
    pub command_results: Signal<TaskMutex, (Command, Result<(), Refusal>)>,
    state: Mutex<TaskMutex, Cell<LineState>>,
}

impl LineLinks {
    const fn new() -> Self {
        Self {
            heartbeat: AtomicU32::new(0),
            messages: Channel::new(),
            command_results: Signal::new(),
            state: Mutex::new(Cell::new(LineState { protocol: ProtocolKind::Auto, is_armed: None })),
        }
    }
}

#[derive(Debug)]
pub(super) struct Heartbeats {
    pub sensor: AtomicU32,
    pub instrument: AtomicU32,
    pub compass: AtomicU32,
}

/// Number of heartbeat counters of the tasks of every board; each line of a board has a further one.
pub(super) const COMMON_HEARTBEAT_COUNTERS: usize = 3;

pub(super) const MAX_HEARTBEAT_COUNTERS: usize = COMMON_HEARTBEAT_COUNTERS + LINE_COUNT;

impl Heartbeats {
    pub const fn new() -> Self {
        Self { sensor: AtomicU32::new(0), instrument: AtomicU32::new(0), compass: AtomicU32::new(0) }
    }
}

impl TaskLinks {
    /// All heartbeat counters; 0 for a line that does not run.
    pub(super) fn heartbeat_counts(&self) -> [u32; MAX_HEARTBEAT_COUNTERS] {
        let Heartbeats { sensor, instrument, compass } = &self.heartbeats;
        let [one, two, can] = self.lines.each_ref().map(|line| &line.heartbeat);
        [sensor, instrument, compass, one, two, can].map(|beat| beat.load(Ordering::Relaxed))
    }
}
