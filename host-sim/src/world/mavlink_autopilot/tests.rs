//! The autopilot alone, and together with the module's protocol.

use std::cell::RefCell;
use std::rc::Rc;

use autoswing::compass::Glance;
use autoswing::earth::Day;
use autoswing::instrument::Estimate;
use autoswing::port::{Facts, Heard, Mavlink, Order, Output, Protocol};
use autoswing::settings::Settings;
use autoswing::time::Timestamp;

use embassy_time::{Duration, with_timeout};
use embedded_io_async::{Read, Write};

use super::*;
use crate::clock;
use crate::devices::uart::Cable;
use crate::simulation::{Level, Simulation};
use crate::world::attitude_source::{Config, Identity, Kind};
use crate::world::far_end::FarEnd;
use crate::world::{World, WorldConfig};

const ATTITUDE: u32 = 30;
const CURRENT: u32 = 1;
const POSITION: u32 = 33;
const TIME: u32 = 2;

/// What the module asks for: a message by its interval, or the stream of attitude.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Request {
    Message { id: u32, rate_hz: u32 },
    Stream { rate_hz: u8 },
}

fn request(frame: &Frame) -> Option<Request> {
    const COMMAND_LONG: u32 = 76;
    match frame.id {
        COMMAND_LONG => {
            Some(Request::Message { id: frame.float(0) as u32, rate_hz: (1e6 / frame.float(4)).round() as u32 })
        }
        REQUEST_DATA_STREAM => Some(Request::Stream { rate_hz: frame.byte(0) }),
        _ => None,
    }
}

/// A module and an autopilot on a line without delay, on a clock of milliseconds.
struct Bench {
    autopilot: MavlinkAutopilot,
    module: Mavlink,
    ms: u64,
    /// The autopilot is switched off until then.
    silent_until_ms: u64,
    heard: Vec<(u64, Heard)>,
    frames: Vec<(u64, Frame)>,
    seen: Seen,
}

impl Bench {
    fn new(firmware: Firmware) -> Self {
        let source = AttitudeSource::new(Config::default(), 1);
        Self {
            autopilot: MavlinkAutopilot::new(source, firmware, 0),
            module: Mavlink::new(),
            ms: 0,
            silent_until_ms: 0,
            heard: vec![],
            frames: vec![],
            seen: Seen::default(),
        }
    }

    fn run(&mut self, seconds: u64) {
        for ms in self.ms..self.ms + 1000 * seconds {
            self.ms = ms;
            let sent = self.autopilot.send(1000 * ms, &self.seen, |_| ());
            if ms >= self.silent_until_ms {
                self.deliver(&sent);
            }
            // A sensor of 80 Hz, nearly.
            if ms.is_multiple_of(12) {
                self.poll();
            }
        }
        self.ms += 1;
    }

    fn deliver(&mut self, bytes: &[u8]) {
        let at = Timestamp::from_us(1000 * self.ms);
        for &byte in bytes {
            self.heard.extend(self.module.byte(at, byte).map(|heard| (self.ms, heard)));
        }
    }

    fn poll(&mut self) {
        let facts = Facts {
            now: Timestamp::from_us(1000 * self.ms),
            estimate: &Estimate::NOTHING,
            settings: &Settings::DEFAULT,
            glance: Glance::Waiting,
            calibration: None,
        };
        let mut out = Output::new();
        self.module.poll(&facts, &mut out);
        self.autopilot.receive(1000 * self.ms, out.pending());
        self.frames.extend(self.autopilot.take_heard().into_iter().map(|frame| (self.ms, frame)));
    }

    fn requests(&self) -> Vec<(u64, Request)> {
        self.frames.iter().filter_map(|(ms, frame)| Some((*ms, request(frame)?))).collect()
    }

    fn asked(&self) -> Vec<Request> {
        self.requests().into_iter().map(|(_, request)| request).collect()
    }

    /// Attitudes that were taken in the last second.
    fn attitudes_in_the_last_second(&self) -> usize {
        let is_one = |(ms, heard): &&(u64, Heard)| *ms + 1000 >= self.ms && matches!(heard, Heard::Attitude(_));
        self.heard.iter().filter(is_one).count()
    }
}

const fn attitude(rate_hz: u32) -> Request {
    Request::Message { id: ATTITUDE, rate_hz }
}

const CURRENT_PLACE_AND_TIME: [Request; 3] = [
    Request::Message { id: CURRENT, rate_hz: 10 },
    Request::Message { id: POSITION, rate_hz: 1 },
    Request::Message { id: TIME, rate_hz: 1 },
];

/// No request sooner than a second after another, whatever happens.
fn assert_paced(bench: &Bench) {
    for pair in bench.requests().windows(2) {
        assert!(pair[1].0 - pair[0].0 >= 1000, "{pair:?}");
    }
}

/// An aeroplane's loop cannot do 50 Hz: one denial, and it is 40. Three seconds: one of looking, one for each question.
#[test]
fn on_ardupilot_attitude_settles_at_40_hz() {
    let mut bench = Bench::new(Firmware::ArduPilot);
    bench.run(4);
    assert_eq!(bench.asked()[..2], [attitude(50), attitude(40)]);
    assert!(bench.requests()[1].0 <= 2_100, "{:?}", bench.requests());
    bench.run(60);
    assert_eq!(bench.asked()[2..], CURRENT_PLACE_AND_TIME, "and nothing more");
    assert!(bench.attitudes_in_the_last_second().abs_diff(40) <= 1);
    assert_paced(&bench);
    assert_eq!((bench.autopilot.garbage(), bench.module.rejected()), (0, 0));
}

/// What comes by itself is not asked for.
#[test]
fn on_px4_attitude_is_there() {
    let mut bench = Bench::new(Firmware::Px4);
    bench.run(60);
    assert_eq!(bench.asked(), CURRENT_PLACE_AND_TIME);
    assert!(bench.attitudes_in_the_last_second().abs_diff(100) <= 1);
}

#[test]
fn who_knows_only_streams_is_asked_for_one() {
    let mut bench = Bench::new(Firmware::Streams);
    bench.run(60);
    let mut expected: Vec<Request> = [50, 40, 25, 20].into_iter().flat_map(|rate| [attitude(rate); 2]).collect();
    expected.push(Request::Stream { rate_hz: 25 });
    // The messages cannot be had, and twice each is enough.
    expected.extend(CURRENT_PLACE_AND_TIME.into_iter().flat_map(|request| [request; 2]));
    assert_eq!(bench.asked(), expected);
    assert!(bench.attitudes_in_the_last_second().abs_diff(25) <= 1);
    assert_paced(&bench);
}

/// Each wish twice, then it is content with what comes.
#[test]
fn who_never_answers_is_left_alone() {
    let mut bench = Bench::new(Firmware::Deaf);
    bench.run(120);
    assert_eq!(bench.asked().len(), 2 * 8);
    assert!(bench.requests().last().unwrap().0 < 18_000);
    assert_eq!(bench.attitudes_in_the_last_second(), 1);
    assert_paced(&bench);
}

/// It comes back as it was switched on, within three seconds of silence or in none.
#[test]
fn after_a_restart_or_a_silence_it_is_asked_again() {
    for silence_ms in [0, 1_500, 10_000] {
        let mut bench = Bench::new(Firmware::ArduPilot);
        bench.run(20);
        let before = bench.asked().len();
        bench.autopilot.restart(1000 * bench.ms);
        bench.silent_until_ms = bench.ms + silence_ms;
        bench.run(silence_ms / 1000 + 8);
        assert!(bench.attitudes_in_the_last_second().abs_diff(40) <= 1, "{silence_ms}");
        assert!(bench.asked()[before..].contains(&attitude(40)), "{silence_ms}");
        assert_paced(&bench);
    }
}

/// Without a restart a line that was cut for long is the same line.
#[test]
fn a_short_gap_changes_nothing() {
    let mut bench = Bench::new(Firmware::ArduPilot);
    bench.run(20);
    let before = bench.asked().len();
    bench.silent_until_ms = bench.ms + 1_900;
    bench.run(10);
    assert_eq!(bench.asked().len(), before);
    bench.silent_until_ms = bench.ms + 2_200;
    bench.run(10);
    assert!(bench.asked().len() > before);
}

#[test]
fn place_and_day_are_the_autopilot_s() {
    let mut bench = Bench::new(Firmware::ArduPilot);
    bench.run(10);
    let place = bench.heard.iter().rev().find_map(|(_, heard)| match heard {
        Heard::Place(place) => Some(*place),
        _ => None,
    });
    let place = place.expect("a place");
    assert!((f64::from(place.latitude_deg) - XIAN.latitude_deg).abs() < 1e-5);
    assert!((f64::from(place.longitude_deg) - XIAN.longitude_deg).abs() < 1e-5);
    assert!((f64::from(place.height_m) - XIAN.height_m).abs() < 0.1);
    let today = Day::from_unix_s(BEGAN_UNIX_US / 1_000_000).unwrap();
    assert!(bench.heard.iter().any(|(_, heard)| *heard == Heard::Day(today)));
    // Without a fix there is no place, and the day goes on.
    bench.autopilot.set_place(None);
    bench.heard.clear();
    bench.run(10);
    let number = |is_one: fn(&Heard) -> bool| bench.heard.iter().filter(|(_, heard)| is_one(heard)).count();
    assert_eq!(number(|heard| matches!(heard, Heard::Place(_))), 0);
    assert!(number(|heard| matches!(heard, Heard::Day(_))).abs_diff(10) <= 1);
}

/// Another aircraft's autopilot on the line, as a radio relays it, is not asked, and not believed.
#[test]
fn a_second_autopilot_is_left_alone() {
    let mut bench = Bench::new(Firmware::ArduPilot);
    let foreign = Identity { system_id: 9, component_id: 1, heartbeats: Some(Kind::Autopilot) };
    let source = AttitudeSource::new(Config::default(), 2).sent_by(foreign);
    let mut other = MavlinkAutopilot::new(source, Firmware::Px4, 0);
    bench.run(1);
    for _ in 0..10 {
        bench.run(1);
        let bytes = other.send(1000 * bench.ms, &Seen { is_armed: true, ..Seen::default() }, |_| ());
        bench.deliver(&bytes);
    }
    assert!(bench.frames.iter().all(|(_, frame)| (frame.system, frame.component) == (1, 158)));
    assert!(bench.heard.iter().any(|(_, heard)| *heard == Heard::Foreign));
    assert_eq!(bench.module.is_armed(Timestamp::from_us(1000 * bench.ms)), Some(false));
    assert_eq!(bench.autopilot.rate_hz(ATTITUDE), Some(40.0));
}

/// A ground station's command goes by way of the line, and its answer back to it.
#[test]
fn a_ground_station_commands_the_module() {
    const STATION: [u8; 2] = [255, 190];
    let mut bench = Bench::new(Firmware::ArduPilot);
    bench.run(5);
    bench.deliver(&command_long(STATION, 1, 42_424, 0, [0.0; 7]));
    assert_eq!(bench.heard.last().unwrap().1, Heard::Asked(Order::Start));
    bench.module.answer(Order::Start, Ok(()));
    bench.run(1);
    let ack = bench.frames.iter().find(|(_, frame)| frame.id == 77).map(|(_, frame)| frame).expect("an answer");
    assert_eq!(ack.payload, [0xB8, 0xA5, 0, 0, 0, 0, 0, 0, 255, 190]);
}

/// As a task of the world, at a cable of 115,200 baud: ten seconds of a module that asks and is answered.
#[test]
fn it_answers_over_a_cable() {
    let mut simulation = Simulation::new();
    let world = World::new(WorldConfig::table1(1));
    let cable = Cable::new(crate::devices::uart::Config::default());
    let (mut rx, mut tx) = cable.module();
    let times = Rc::new(RefCell::new(Vec::new()));
    let log = Rc::clone(&times);
    simulation.spawn(Level::Thread, "module", async move {
        let mut module = Mavlink::new();
        let mut buffer = [0; 64];
        loop {
            let read = with_timeout(Duration::from_millis(10), rx.read(&mut buffer)).await.map_or(0, Result::unwrap);
            let now = Timestamp::from_us(clock::now_us());
            let heard = buffer[..read].iter().filter_map(|&byte| module.byte(now, byte));
            log.borrow_mut().extend(heard.filter(|heard| matches!(heard, Heard::Attitude(_))).map(|_| now.as_us()));
            let facts = Facts {
                now,
                estimate: &Estimate::NOTHING,
                settings: &Settings::DEFAULT,
                glance: Glance::Waiting,
                calibration: None,
            };
            let mut out = Output::new();
            module.poll(&facts, &mut out);
            tx.write_all(out.pending()).await.unwrap();
        }
    });
    FarEnd::Mavlink(Firmware::ArduPilot).attach(&mut simulation, &world, cable.host(), vec![]);
    simulation.run_until(10_000_000);
    let last_second = times.borrow().iter().filter(|&&us| us > 9_000_000).count();
    assert!(last_second.abs_diff(40) <= 1, "{last_second}");
    world.set_sends_attitude(false);
    times.borrow_mut().clear();
    simulation.run_until(12_000_000);
    assert_eq!(times.borrow().len(), 0, "somebody else has the line");
}

/// Frames that are cut, joined and surrounded by noise.
#[test]
fn the_reader_finds_every_frame() {
    let frame = Frame { sequence: 3, system: 1, component: 158, id: 191, payload: vec![7; 17] };
    let bytes = [&[0xFD, 2, 3][..], &frame.bytes(92), b"noise", &frame.bytes(92)].concat();
    for cut in 0..bytes.len() {
        let mut reader = Reader::default();
        let mut found = reader.read(&bytes[..cut]);
        found.extend(reader.read(&bytes[cut..]));
        assert_eq!((found, reader.garbage()), (vec![frame.clone(), frame.clone()], 8), "{cut}");
    }
}
