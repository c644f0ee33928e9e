//! Whose attitude is believed: one sender's, an autopilot's if there is any.
//!
//! Several may send attitude on one line: an autopilot, its gimbal, another aircraft that the radio relays. Two of them,
//! 5 deg apart, taken for one, made headings that were 10 deg wrong. So:
//!
//! - The attitude of a sender whose heartbeat says that it is an autopilot is taken, and no other.
//! - While no autopilot's heartbeat is known, the first sender's is, unless its own heartbeat says that it is none. An
//!   autopilot's heartbeat ends that at once.
//! - Who is chosen stays chosen, also among autopilots, until nothing came from it for [`MEMORY_US`]. It is chosen when
//!   its attitude comes, so that one that only sends heartbeats is in nobody's way.
//! - A heartbeat is forgotten after [`MEMORY_US`].

use crate::time::Timestamp;

/// Who sent something: a number that tells senders apart and means nothing else.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Source(u16);

impl Source {
    /// The sender with this number. What has a single sender, a recording for example, uses the default.
    #[must_use]
    pub const fn new(number: u16) -> Self {
        Self(number)
    }

    /// Its number.
    #[must_use]
    pub const fn number(self) -> u16 {
        self.0
    }
}

/// What a sender says of itself, about once a second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Heartbeat {
    /// Who says it.
    pub source: Source,
    /// Whether it is an autopilot.
    pub is_autopilot: bool,
    /// Whether it is armed.
    pub is_armed: bool,
}

/// A sender is released, a heartbeat forgotten, after so long a silence, microseconds: ten heartbeats.
const MEMORY_US: u64 = 10_000_000;

/// So many senders are known at once.
const MAX_KNOWN: usize = 8;

/// A sender, and when it was heard.
#[derive(Clone, Copy, Debug)]
struct Known {
    source: Source,
    heartbeat: Option<(Timestamp, Heartbeat)>,
    attitude_at: Option<Timestamp>,
}

impl Known {
    /// What it says of itself, if that is not forgotten.
    fn heartbeat(&self, now: Timestamp) -> Option<Heartbeat> {
        self.heartbeat.filter(|(at, _)| is_recent(*at, now)).map(|(_, heartbeat)| heartbeat)
    }

    /// How dear it is: those that have sent attitude lately before those that have not, however many heartbeats these
    /// send; then those heard last.
    fn rank(&self, now: Timestamp) -> (bool, Timestamp) {
        let heard = self.heartbeat.map(|(at, _)| at).max(self.attitude_at).unwrap_or_default();
        (self.attitude_at.is_some_and(|at| is_recent(at, now)), heard)
    }
}

/// The sender that is believed.
#[derive(Clone, Copy, Debug)]
struct Chosen {
    source: Source,
    attitude_at: Timestamp,
    /// Whether its heartbeat said so; if none did it is the first sender.
    is_autopilot: bool,
}

/// The senders of a line, and which of them is believed.
#[derive(Debug, Default)]
pub struct Senders {
    known: heapless::Vec<Known, MAX_KNOWN>,
    /// It keeps its place until another takes it: whether it is armed is asked of it even when its attitude fails.
    chosen: Option<Chosen>,
}

impl Senders {
    /// Nobody was heard yet.
    #[must_use]
    pub const fn new() -> Self {
        Self { known: heapless::Vec::new(), chosen: None }
    }

    /// Takes a heartbeat that came at `now`.
    pub fn hear(&mut self, now: Timestamp, heartbeat: Heartbeat) {
        let Heartbeat { source, is_autopilot, .. } = heartbeat;
        if let Some(known) = self.entry(now, source) {
            known.heartbeat = Some((now, heartbeat));
        }
        self.chosen = match self.chosen {
            Some(chosen) if chosen.source == source => is_autopilot.then_some(Chosen { is_autopilot, ..chosen }),
            // The first sender gives way to an autopilot.
            Some(chosen) if is_autopilot && !chosen.is_autopilot => None,
            other => other,
        };
    }

    /// Whether the attitude that came at `now` from a sender is to be taken.
    pub fn takes(&mut self, now: Timestamp, source: Source) -> bool {
        if let Some(known) = self.entry(now, source) {
            known.attitude_at = Some(now);
        }
        let holder = self.chosen.filter(|chosen| is_recent(chosen.attitude_at, now));
        let next = match holder {
            Some(holder) => (holder.source == source).then_some(holder),
            None => self.candidate(now, source),
        };
        if let Some(next) = next {
            self.chosen = Some(Chosen { attitude_at: now, ..next });
        }
        next.is_some()
    }

    /// Whether the autopilot that is believed is armed, if it has said so lately.
    #[must_use]
    pub fn is_armed(&self, now: Timestamp) -> Option<bool> {
        self.chosen.and_then(|chosen| self.heartbeat(now, chosen.source)).map(|heartbeat| heartbeat.is_armed)
    }

    /// The autopilot to be asked: the one that is believed, or before any sends attitude the one that was heard of first,
    /// if it has said lately that it is one.
    #[must_use]
    pub fn autopilot(&self, now: Timestamp) -> Option<Source> {
        let chosen = self.chosen.filter(|chosen| chosen.is_autopilot).map(|chosen| chosen.source);
        let heard = || self.known.iter().filter_map(|known| known.heartbeat(now)).find(|heard| heard.is_autopilot);
        chosen.or_else(|| heard().map(|heartbeat| heartbeat.source))
    }

    /// The sender as the one to be believed, if it may be.
    fn candidate(&self, now: Timestamp, source: Source) -> Option<Chosen> {
        let own = self.heartbeat(now, source);
        let autopilots = || self.known.iter().filter_map(|known| known.heartbeat(now)).any(|other| other.is_autopilot);
        let may = own.map_or_else(|| !autopilots(), |own| own.is_autopilot);
        may.then_some(Chosen { source, attitude_at: now, is_autopilot: own.is_some() })
    }

    fn heartbeat(&self, now: Timestamp, source: Source) -> Option<Heartbeat> {
        self.known.iter().find(|known| known.source == source)?.heartbeat(now)
    }

    /// The place of a sender. One that is new gets one, that of the least dear if there is no other, but never that of
    /// the chosen one.
    fn entry(&mut self, now: Timestamp, source: Source) -> Option<&mut Known> {
        if self.known.iter().all(|known| known.source != source) {
            if self.known.is_full() {
                let chosen = self.chosen.map(|chosen| chosen.source);
                let others = self.known.iter().enumerate().filter(|(_, known)| Some(known.source) != chosen);
                let (least, _) = others.min_by_key(|(_, known)| known.rank(now))?;
                self.known.swap_remove(least);
            }
            // There is room: one was just taken out if there was none.
            let _ = self.known.push(Known { source, heartbeat: None, attitude_at: None });
        }
        self.known.iter_mut().find(|known| known.source == source)
    }
}

fn is_recent(at: Timestamp, now: Timestamp) -> bool {
    now.us_since(at) <= MEMORY_US
}

#[cfg(test)]
mod tests {
    use super::*;
    use Said::{Armed, Nothing, Other, Ready};

    const AUTOPILOT: Source = Source::new(0x0101);
    const SECOND: Source = Source::new(0x0201);
    const GIMBAL: Source = Source::new(0x019A);

    /// What a sender says of itself.
    #[derive(Clone, Copy, PartialEq)]
    enum Said {
        Nothing,
        Other,
        Ready,
        Armed,
    }

    /// Senders and a clock, milliseconds.
    struct Bed {
        senders: Senders,
        ms: u64,
    }

    impl Bed {
        /// An hour after the start.
        fn new() -> Self {
            Self { senders: Senders::new(), ms: 3_600_000 }
        }

        fn now(&self) -> Timestamp {
            Timestamp::from_us(self.ms * 1000)
        }

        fn hear(&mut self, source: Source, said: Said) {
            let now = self.now();
            let heartbeat = Heartbeat { source, is_autopilot: said != Other, is_armed: said == Armed };
            self.senders.hear(now, heartbeat);
        }

        fn takes(&mut self, source: Source) -> bool {
            let now = self.now();
            self.senders.takes(now, source)
        }

        fn is_armed(&self) -> bool {
            self.senders.is_armed(self.now()) == Some(true)
        }

        /// So many seconds in which each sends attitude, 20 times a second, and says what it is once a second; how much
        /// of each one's attitude was taken.
        fn run<const N: usize>(&mut self, seconds: u64, sources: [(Source, Said); N]) -> [u64; N] {
            let mut taken = [0; N];
            for tick in 0..seconds * 20 {
                for (&(source, said), taken) in sources.iter().zip(&mut taken) {
                    if tick % 20 == 0 && said != Nothing {
                        self.hear(source, said);
                    }
                    *taken += u64::from(self.takes(source));
                }
                self.ms += 50;
            }
            taken
        }
    }

    #[test]
    fn the_autopilot_is_believed_and_nobody_else() {
        let mut bed = Bed::new();
        let sources = [(GIMBAL, Other), (AUTOPILOT, Ready), (Source::new(7), Nothing)];
        assert_eq!(bed.run(30, sources), [0, 600, 0]);
    }

    #[test]
    fn without_heartbeats_the_first_sender_is_believed() {
        let mut bed = Bed::new();
        assert_eq!(bed.run(30, [(GIMBAL, Nothing), (AUTOPILOT, Nothing)]), [600, 0]);
    }

    /// Those of a camera, a radio and a ground station are no autopilots', and change nothing.
    #[test]
    fn heartbeats_of_others_are_none_of_an_autopilot() {
        let mut bed = Bed::new();
        assert_eq!(bed.run(3, [(GIMBAL, Other)]), [0]);
        assert_eq!(bed.run(3, [(AUTOPILOT, Nothing), (GIMBAL, Other)]), [60, 0]);
    }

    #[test]
    fn a_first_sender_is_dropped_when_an_autopilot_is_heard() {
        let mut bed = Bed::new();
        assert!(bed.takes(GIMBAL));
        bed.hear(AUTOPILOT, Ready);
        assert!(!bed.takes(GIMBAL), "before the autopilot sends attitude");
        assert!(bed.takes(AUTOPILOT));
        assert!(!bed.takes(GIMBAL));
    }

    #[test]
    fn a_first_sender_that_turns_out_to_be_the_autopilot_stays_and_one_that_does_not_goes() {
        for (said, stays) in [(Ready, true), (Other, false)] {
            let mut bed = Bed::new();
            assert!(bed.takes(AUTOPILOT));
            bed.hear(AUTOPILOT, said);
            assert_eq!(bed.takes(AUTOPILOT), stays);
            // Known as an autopilot it keeps its place, also when another is heard.
            bed.hear(SECOND, Ready);
            assert_eq!((bed.takes(SECOND), bed.takes(AUTOPILOT)), (!stays, stays));
        }
    }

    #[test]
    fn of_two_autopilots_the_first_chosen_keeps_it() {
        let mut bed = Bed::new();
        assert_eq!(bed.run(30, [(SECOND, Ready), (AUTOPILOT, Ready)]), [600, 0]);
    }

    /// Ten seconds, from both sides, while the other one never stops.
    #[test]
    fn a_silent_sender_is_released_after_ten_seconds() {
        let mut bed = Bed::new();
        for source in [AUTOPILOT, SECOND] {
            bed.hear(source, Ready);
        }
        assert!(bed.takes(AUTOPILOT));
        bed.ms += 9_000;
        bed.hear(SECOND, Ready);
        bed.ms += 1_000;
        assert!(!bed.takes(SECOND));
        bed.ms += 1;
        assert!(bed.takes(SECOND));
        bed.hear(AUTOPILOT, Ready);
        assert!(!bed.takes(AUTOPILOT), "it is the other one's turn");
    }

    #[test]
    fn whoever_only_sends_heartbeats_is_in_no_autopilot_s_way() {
        let mut bed = Bed::new();
        for _ in 0..20 {
            bed.hear(SECOND, Ready);
            assert_eq!(bed.run(1, [(AUTOPILOT, Ready)]), [20]);
        }
    }

    /// A heartbeat counts for ten seconds, from both sides: then the first sender is believed again.
    #[test]
    fn an_autopilot_s_heartbeat_is_forgotten_after_ten_seconds() {
        let mut bed = Bed::new();
        bed.hear(AUTOPILOT, Ready);
        bed.ms += 10_000;
        assert!(!bed.takes(GIMBAL));
        bed.ms += 1;
        assert!(bed.takes(GIMBAL));
    }

    /// One that was known as an autopilot is not asked again while its attitude comes.
    #[test]
    fn the_chosen_one_stays_without_further_heartbeats() {
        let mut bed = Bed::new();
        bed.hear(AUTOPILOT, Ready);
        assert_eq!(bed.run(30, [(AUTOPILOT, Nothing), (SECOND, Ready)]), [600, 0]);
    }

    /// Before attitude comes it is the first that was heard, for ten seconds after its last heartbeat, from both sides; then
    /// it is the one whose attitude is taken, for as long as that keeps its place.
    #[test]
    fn the_autopilot_to_be_asked_is_the_one_that_is_believed() {
        let mut bed = Bed::new();
        let asked = |bed: &Bed| bed.senders.autopilot(bed.now());
        bed.hear(GIMBAL, Other);
        assert_eq!(asked(&bed), None);
        bed.hear(AUTOPILOT, Ready);
        bed.hear(SECOND, Ready);
        assert_eq!(asked(&bed), Some(AUTOPILOT));
        bed.ms += 10_000;
        assert_eq!(asked(&bed), Some(AUTOPILOT));
        bed.ms += 1;
        assert_eq!(asked(&bed), None);
        for source in [AUTOPILOT, SECOND] {
            bed.hear(source, Ready);
        }
        assert!(bed.takes(SECOND));
        assert_eq!(asked(&bed), Some(SECOND));
        bed.ms += 60_000;
        assert_eq!(asked(&bed), Some(SECOND), "it keeps its place");
        bed.hear(AUTOPILOT, Ready);
        assert!(bed.takes(AUTOPILOT));
        assert_eq!(asked(&bed), Some(AUTOPILOT));
        // A first sender without heartbeats is nobody to ask.
        let mut bed = Bed::new();
        assert!(bed.takes(GIMBAL));
        assert_eq!(asked(&bed), None);
    }

    #[test]
    fn armed_is_what_the_chosen_autopilot_said_last() {
        let mut bed = Bed::new();
        bed.hear(AUTOPILOT, Armed);
        assert!(!bed.is_armed(), "nobody is chosen yet");
        assert!(bed.takes(AUTOPILOT) && bed.is_armed());
        bed.hear(SECOND, Ready);
        bed.hear(GIMBAL, Other);
        assert!(bed.is_armed());
        bed.hear(AUTOPILOT, Ready);
        bed.hear(SECOND, Armed);
        assert!(!bed.is_armed());
        // A first sender that has not said anything.
        let mut bed = Bed::new();
        assert!(bed.takes(AUTOPILOT) && !bed.is_armed());
    }

    /// For ten seconds after the last heartbeat, from both sides; attitude does not prolong it, nor its loss shorten it.
    #[test]
    fn armed_is_forgotten_after_ten_seconds_without_a_heartbeat() {
        for attitude_ends_ms in [0, 20_000] {
            let mut bed = Bed::new();
            bed.hear(AUTOPILOT, Armed);
            for ms in (0..=10_000).step_by(100) {
                assert!(ms > attitude_ends_ms || bed.takes(AUTOPILOT));
                assert!(bed.is_armed(), "{ms}");
                bed.ms += 100;
            }
            bed.ms -= 99;
            assert!(!bed.is_armed());
        }
    }

    /// Forged senders that say they are autopilots, more than are known at once, between any two frames of the true
    /// one, before it is chosen and after.
    #[test]
    fn a_flood_of_heartbeats_keeps_nobody_out() {
        let mut bed = Bed::new();
        let mut taken = 0;
        for tick in 0..600_u16 {
            for forged in 0..20 {
                bed.hear(Source::new(0x4000 + (tick % 50) * 20 + forged), Ready);
            }
            // Its first heartbeat comes after a second of attitude.
            if tick % 20 == 19 {
                bed.hear(AUTOPILOT, Armed);
            }
            taken += u16::from(bed.takes(AUTOPILOT));
            assert_eq!(bed.is_armed(), tick >= 19);
            bed.ms += 50;
        }
        assert_eq!(taken, 600 - 19);
    }

    /// Nine senders of attitude: the chosen one, which was heard first and longest ago, is not forgotten.
    #[test]
    fn the_chosen_one_keeps_its_place_among_the_known() {
        let mut bed = Bed::new();
        bed.hear(AUTOPILOT, Armed);
        assert!(bed.takes(AUTOPILOT));
        for other in 0..20 {
            bed.ms += 100;
            bed.hear(Source::new(other), Ready);
            assert!(!bed.takes(Source::new(other)));
        }
        assert!(bed.is_armed() && bed.takes(AUTOPILOT));
        assert_eq!(bed.senders.known.len(), MAX_KNOWN);
    }

    /// Of those that are alike the one heard longest ago is forgotten: the gimbal is still known to be none.
    #[test]
    fn the_oldest_makes_room() {
        let mut bed = Bed::new();
        for other in 0..7 {
            bed.hear(Source::new(other), Other);
            bed.ms += 1;
        }
        bed.hear(GIMBAL, Other);
        for other in 0..7 {
            bed.ms += 1;
            bed.hear(Source::new(100 + other), Other);
        }
        assert!(!bed.takes(GIMBAL));
        for other in 0..7 {
            assert!(bed.senders.heartbeat(bed.now(), Source::new(other)).is_none(), "{other}");
        }
    }
}
