//! The instrument: readings and attitude in, headings and samples out. A pure value without I/O, clock or executor.
//!
//! It owns everything between the wires and a heading: the attitude track, the correction in force, the pairing of
//! readings with the attitude at their instants, and the averaging to samples. Whoever drives it - a task, a recording
//! that is replayed, a test - says what arrived and when, and passes on what comes out:
//!
//! ```text
//! on_attitude(at, Report) ---> track ---+
//! on_reading(at, Reading) --------------+---> Estimate
//! on_silence(at) -----------------------+
//!                                       +---> pairing ---> averager ---> next_sample()
//! ```
//!
//! An estimate is made at once, with the attitude carried on to the reading's instant if need be. A sample is not in a
//! hurry: it waits for the report after it, so that its attitude is interpolated.
//!
//! ```
//! use autoswing::attitude::{Report, Source};
//! use autoswing::calibration::{Calibration, Orientation, Uncertainty};
//! use autoswing::frames::{Attitude, Field};
//! use autoswing::instrument::{Config, Correction, Instrument};
//! use autoswing::magnetometer::Reading;
//! use autoswing::time::{Timestamp, WrappingMillis};
//!
//! // A magnetometer of 100 Hz, and an attitude source whose reports are 20 ms old when they arrive.
//! let mut instrument = Instrument::new(Config::new(10_000));
//! // What a solve found: here an aircraft without iron, in a field of 50 uT that dips by 60 deg.
//! let calibration = Calibration {
//!     inclination_rad: 60_f32.to_radians(),
//!     total_ut: 50.0,
//!     ..Calibration::uncalibrated(Orientation::NONE)
//! };
//! instrument.correct_with(Correction { calibration: Some((calibration, Uncertainty::NONE)), ..Correction::NONE });
//!
//! let attitude = Attitude::from_deg(20.0, 3.0);
//! let sender_time = WrappingMillis::new(0);
//! let report = Report { source: Source::default(), sender_time, attitude, rates_rad_s: [0.0; 3] };
//! instrument.on_attitude(Timestamp::from_us(1_000_000), report);
//! let field = Field::new(attitude.body(Field::earth(50.0, 60_f32.to_radians(), 1.2)).ut);
//! let reading = Reading { field, saturated: false, overrun: false };
//! let estimate = instrument.on_reading(Timestamp::from_us(1_010_000), reading);
//! assert!((estimate.heading.unwrap().magnetic_rad - 1.2).abs() < 1e-4);
//! ```

mod averager;
mod compass_field;
mod pairing;
mod sensor;
mod smoother;
#[cfg(test)]
mod tests;
mod watch;

use crate::attitude::{self, Doubted, Lookup, Motion, Report, Track, Turning};
use crate::calibration::{CURRENT_IS_LOOKED_FOR, Calibration, Orientation, Sample, Uncertainty};
use crate::frames::{Attitude, Body, Field, Sensor};
use crate::heading::{self, Heading, NoHeading};
use crate::magnetometer::Reading;
use crate::time::Timestamp;
use compass_field::CompassField;
use pairing::Pairing;
use sensor::{Fault, SensorCheck};
use smoother::Smoother;
pub use watch::{Iron, IronNews};
use watch::{Watch, Watched};

/// Fixed numbers of an instrument.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// Time between two readings, microseconds.
    pub reading_period_us: u32,
    /// After so many equal readings an axis of the sensor is stuck; none: its readings may repeat.
    pub stuck_after: Option<u16>,
    /// Numbers for the attitude source, its latency among them.
    pub attitude: attitude::Config,
    /// When a heading is not believed.
    pub heading: heading::Config,
}

/// Time that a sample spans, microseconds. A tenth of a second leaves a third of a reading's noise at 80 Hz, and a turn
/// of 30 deg/s moves by 3 deg within it, which bends the mean by less than 0.02 % of the field.
const SAMPLE_SPAN_US: u32 = 100_000;

/// Readings in the time without a reading after which the sensor counts as silent.
const SILENT_PERIODS: u32 = 8;

/// Fifths of a period that a step between two averaged readings may take: three periods, and a fifth for the clock.
const MAX_STEP_FIFTHS: u64 = 16;

impl Config {
    /// For a magnetometer with this time between two readings, which may repeat, and an ordinary attitude source.
    #[must_use]
    pub const fn new(reading_period_us: u32) -> Self {
        Self {
            reading_period_us,
            stuck_after: None,
            attitude: attitude::Config::DEFAULT,
            heading: heading::Config::DEFAULT,
        }
    }

    /// How many readings are averaged to one sample: ten samples a second, or each reading a sample where those are
    /// slower.
    #[must_use]
    pub const fn readings_per_sample(&self) -> u16 {
        readings_per_sample(self.reading_period_us)
    }

    /// Without a reading for so long the sensor is silent, microseconds.
    #[must_use]
    pub const fn silence_us(&self) -> u64 {
        self.reading_period_us as u64 * SILENT_PERIODS as u64
    }

    const fn max_step_us(&self) -> u64 {
        self.reading_period_us as u64 * MAX_STEP_FIFTHS / 5
    }
}

/// How many readings with this time between them, microseconds, are averaged to one sample; one at least.
#[must_use]
pub const fn readings_per_sample(reading_period_us: u32) -> u16 {
    // A period of zero is no sensor's.
    let period_us = if reading_period_us == 0 { 1 } else { reading_period_us };
    let readings = (SAMPLE_SPAN_US + period_us / 2) / period_us;
    if readings == 0 {
        1
    } else if readings > u16::MAX as u32 {
        u16::MAX
    } else {
        readings as u16
    }
}

/// What the instrument corrects with. Replaced as a whole, so that a heading never mixes two calibrations.
#[derive(Clone, Debug, PartialEq)]
pub struct Correction {
    /// The calibration in use, and how wrong a heading by it may be.
    pub calibration: Option<(Calibration, Uncertainty)>,
    /// Whether the inclination it was found in is known, so that a field of another can be told.
    pub knows_inclination: bool,
    /// Added to every heading, degrees.
    pub align_deg: f32,
    /// Where the attitude of samples comes from.
    pub sample_attitude: SampleAttitude,
    /// How the chip sits, once it is known which chip it is: by this the field is told as it is read, as long as no
    /// calibration has been in use.
    pub mount: Option<Orientation>,
    /// Total intensity of the Earth's field here and now, microtesla, if it is known.
    pub total_ut: Option<f32>,
    /// Whether the autopilot is armed, if it has said so.
    pub is_armed: Option<bool>,
}

impl Correction {
    /// Of a module without a calibration.
    pub const NONE: Self = Self {
        calibration: None,
        knows_inclination: true,
        align_deg: 0.0,
        sample_attitude: SampleAttitude::Interpolated,
        mount: None,
        total_ut: None,
        is_armed: None,
    };

    /// Whether headings by the other one are the same.
    fn is_alike(&self, other: &Self) -> bool {
        self.calibration == other.calibration
            && self.knows_inclination == other.knows_inclination
            && self.align_deg.to_bits() == other.align_deg.to_bits()
    }
}

/// Where the attitude of samples comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleAttitude {
    /// From the attitude source, interpolated to the instant of the reading.
    Interpolated,
    /// Nowhere: samples are of the field alone, and their attitude is level.
    Unknown,
}

/// What the instrument knows at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The instant of the reading, or of the silence.
    pub at: Timestamp,
    /// The corrected field in body axes, in the sensor's own microtesla. None without a calibration, and when the
    /// sensor is silent or saturated. It needs no attitude, and alignment is not in it.
    pub body: Option<Field<Body>>,
    /// What an autopilot's compass is to read, microtesla: the field corrected by the calibration as the watch has adjusted
    /// it, alignment included, in the true strength where that is known. None while it is not to be trusted; it needs no
    /// attitude. A module that has not had a calibration yet tells the field as it is read.
    pub compass: Option<Field<Body>>,
    /// The heading, alignment included, or why there is none.
    pub heading: Result<Heading, NoHeading>,
    /// The same smoothed by the attitude source's body rates; none without a heading, and while the rates are not there,
    /// have not been for long, or contradict it.
    pub smooth: Option<Heading>,
    /// The attitude at that instant, if the source's reports reach it.
    pub attitude: Option<Attitude>,
    /// Hard iron that has moved since the calibration, once it is sure.
    pub iron: Option<Iron>,
    /// The current that the motors draw, amperes, if it has been told lately.
    pub current_a: Option<f32>,
}

impl Estimate {
    /// Before the first reading.
    pub const NOTHING: Self = Self {
        at: Timestamp::START,
        body: None,
        compass: None,
        heading: Err(NoHeading::SensorSilent),
        smooth: None,
        attitude: None,
        iron: None,
        current_a: None,
    };
}

/// What was not believed so far, and why; each wraps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Readings for which no attitude came.
    pub unpaired: u32,
    /// Readings at the end of the chip's range.
    pub saturated: u32,
    /// Readings of an axis that ends before its range does.
    pub clipped: u32,
    /// Readings of an axis that repeats itself.
    pub stuck: u32,
    /// Readings too far from the one before.
    pub spikes: u32,
    /// Attitude reports.
    pub attitude: Doubted,
}

impl Counts {
    /// All was believed.
    pub const NONE: Self = Self { unpaired: 0, saturated: 0, clipped: 0, stuck: 0, spikes: 0, attitude: Doubted::NONE };
}

/// The instrument. About 4 KB. What it does is not inlined into the task that drives it, whose stack would be that of all
/// of it at once.
#[derive(Debug)]
pub struct Instrument {
    config: Config,
    correction: Correction,
    track: Track,
    sensor: SensorCheck,
    pairing: Pairing,
    smoother: Smoother,
    counts: Counts,
    watch: Watch,
    /// What the watch has not seen yet: a sample with the instant of its last reading.
    unwatched: Option<(Timestamp, Sample)>,
    /// The calibration in use as the watch has adjusted it.
    in_force: Option<(Calibration, Uncertainty)>,
    compass_field: CompassField,
    /// Whether that has not seen the correction yet: how it goes over to another one takes longer than a heading does.
    is_compass_due: bool,
    /// When the watch last saw a sample.
    watched_at: Timestamp,
    /// Reports in a row whose rates were not believed.
    doubted_rates: u8,
    /// The last current that was told, amperes, and when.
    current: Option<(Timestamp, f32)>,
}

/// After so many reports in a row whose rates contradict them, a fifth of a second, the rates are wrong.
const RATES_ARE_WRONG: u8 = 10;

/// What was told of the current holds for so long, microseconds: autopilots that tell it do so once a second at least.
const CURRENT_HOLDS_US: u64 = 3_000_000;

/// Without an attitude the watch sees nothing: that it last saw a disturbed field counts for so long, microseconds.
const DISTURBED_US: u64 = 10_000_000;

impl Instrument {
    /// An instrument without a calibration. In a function of its own, for what it is put together from lies on the stack
    /// meanwhile.
    #[must_use]
    #[inline(never)]
    pub fn new(config: Config) -> Self {
        Self {
            config,
            correction: Correction::NONE,
            track: Track::new(config.attitude),
            sensor: SensorCheck::new(&config),
            pairing: Pairing::new(config.readings_per_sample(), config.max_step_us()),
            smoother: Smoother::new(),
            counts: Counts::NONE,
            watch: Watch::new(watch::Config::DEFAULT),
            unwatched: None,
            in_force: None,
            compass_field: CompassField::NEW,
            is_compass_due: false,
            watched_at: Timestamp::START,
            doubted_rates: 0,
            current: None,
        }
    }

    /// Corrects with this from now on.
    #[inline(never)]
    pub fn correct_with(&mut self, correction: Correction) {
        if correction.sample_attitude != self.correction.sample_attitude {
            // A sample is made of readings of one kind.
            self.pairing.reset();
        }
        let is_another = correction.calibration != self.correction.calibration;
        if !correction.is_alike(&self.correction) {
            self.smoother.reset();
        }
        self.correction = correction;
        if is_another {
            self.watch_anew();
        } else {
            self.is_compass_due = true;
        }
    }

    /// Forgets what was learnt beyond the calibration: it is another one, or what was learnt was learnt with a gyro that
    /// says what is not so.
    #[inline(never)]
    fn watch_anew(&mut self) {
        self.watch = Watch::new(watch::Config::DEFAULT);
        self.unwatched = None;
        self.in_force = self.correction.calibration;
        self.is_compass_due = true;
    }

    /// The sensor is another one, with this time between two readings, microseconds; after so many equal ones an axis of
    /// it is stuck.
    pub fn set_sensor(&mut self, period_us: u32, stuck_after: Option<u16>) {
        self.config.reading_period_us = period_us;
        self.config.stuck_after = stuck_after;
        self.sensor = SensorCheck::new(&self.config);
        self.pairing.restart(self.config.readings_per_sample(), self.config.max_step_us());
    }

    /// Takes an attitude report whose last byte arrived at `at`. It may complete samples.
    #[inline(never)]
    pub fn on_attitude(&mut self, at: Timestamp, report: Report) {
        let before = self.track.doubted().rates;
        self.track.push(at, report);
        self.compass_field.see_attitude(at, report.attitude);
        let is_doubted = self.track.doubted().rates != before;
        self.doubted_rates = if is_doubted { self.doubted_rates.saturating_add(1) } else { 0 };
        if self.doubted_rates == RATES_ARE_WRONG {
            self.watch_anew();
        }
    }

    /// Takes the current that the motors draw, amperes, as it was told at `at`.
    pub const fn on_current(&mut self, at: Timestamp, amperes: f32) {
        self.current = Some((at, amperes));
    }

    /// The current at an instant, amperes; none if it has not been told for long.
    fn current_a(&self, at: Timestamp) -> Option<f32> {
        let told = self.current.filter(|_| CURRENT_IS_LOOKED_FOR);
        told.filter(|&(told, _)| at.us_since(told) <= CURRENT_HOLDS_US).map(|(_, amperes)| amperes)
    }

    /// Takes a reading that was ready at `at`. It may complete a sample.
    #[inline(never)]
    pub fn on_reading(&mut self, at: Timestamp, reading: Reading) -> Estimate {
        let fault = self.sensor.see(at, &reading, self.track.turning_rad_s());
        if let Some(fault) = fault {
            self.count(fault);
            // What waits for its attitude waits no longer than it would have.
            self.pairing.pass(at);
        } else {
            self.pairing.push(at, reading.field);
            self.track.see_raw_field(reading.field);
        }
        let current_a = self.current_a(at);
        let calibration = self.correction.calibration.as_ref().map(|(calibration, _)| calibration);
        let field = calibration.map_or(reading.field, |in_use| in_use.without_current(reading.field, current_a));
        let body = calibration.filter(|_| fault.is_none()).map(|calibration| calibration.apply(field));
        if let Some(body) = body {
            self.track.see_field(body);
        }
        let attitude = self.attitude_at(at);
        let turning = self.track.turning_at(self.told_at(at));
        let heading =
            fault.map_or_else(|| self.heading(field, current_a, attitude, turning.as_ref()), |fault| Err(fault.into()));
        let smooth = self.smoother.smooth(at, heading.as_ref().ok(), turning);
        let compass = self.compass_field.tell(at, field).filter(|_| self.is_trusted(at, field, &heading));
        Estimate { at, body, compass, heading, smooth, attitude: attitude.ok(), iron: self.iron(), current_a }
    }

    /// No reading has come for [`Config::silence_us`] or longer.
    #[must_use]
    pub fn on_silence(&self, at: Timestamp) -> Estimate {
        let (attitude, current_a) = (self.attitude_at(at).ok(), self.current_a(at));
        Estimate { at, attitude, iron: self.iron(), current_a, ..Estimate::NOTHING }
    }

    /// The next averaged sample with the attitude at its instant, if one is complete. To be asked until there is none
    /// after every reading and every report, for one report can complete several.
    #[inline(never)]
    pub fn next_sample(&mut self) -> Option<Sample> {
        match self.correction.sample_attitude {
            SampleAttitude::Interpolated => {
                let motion_at = |at| self.track.turning_at(at).map_or_else(Motion::default, |turning| turning.motion);
                let (at, mut sample) = self.pairing.next(|at| self.track.at(at), motion_at)?;
                sample.rates = sample.rates.with_current(self.current_a(at));
                self.unwatched = Some((at, sample));
                Some(sample)
            }
            SampleAttitude::Unknown => {
                let at_rest = |_| Motion::default();
                let (at, mut sample) = self.pairing.next(|_| Lookup::Interpolated(Attitude::default()), at_rest)?;
                sample.rates = sample.rates.with_current(self.current_a(at));
                Some(sample)
            }
        }
    }

    /// Whether there is something to [`watch`](Self::watch).
    #[must_use]
    pub const fn has_to_watch(&self) -> bool {
        self.unwatched.is_some() || self.is_compass_due
    }

    /// Holds the last sample's field, attitude and turn against each other, for the headings to come. It takes longer
    /// than a heading does, and may wait until that is sent; of samples that come meanwhile, the last counts. Without an
    /// inclination, or a calibration, nothing is watched. A correction that is new counts for [`Estimate::compass`] from here on.
    #[inline(never)]
    pub fn watch(&mut self) {
        if core::mem::take(&mut self.is_compass_due) {
            self.compass_field.correct_with(&self.correction, self.in_force.as_ref());
        }
        let Some((at, sample)) = self.unwatched.take() else { return };
        let Some((calibration, uncertainty)) = &self.correction.calibration else { return };
        if !self.correction.knows_inclination {
            return;
        }
        // The sample is of the middle between its readings.
        let ahead_s = at.wrapping_millis().difference(sample.time) as f32 * 1e-3;
        let turning = self.track.turning_at(self.told_at(at)).map(|turning| turning.before(ahead_s));
        let readings_per_sample = self.config.readings_per_sample();
        let watched = Watched { calibration, uncertainty, readings_per_sample };
        self.watch.see(&watched, at, &sample, turning);
        self.in_force = Some(self.watch.adjustment().in_force(&watched));
        self.watched_at = at;
        self.compass_field.follow(&self.correction, self.in_force.as_ref());
    }

    /// Hard iron that has moved since the calibration, once it is sure.
    #[must_use]
    pub const fn iron(&self) -> Option<Iron> {
        self.watch.adjustment().iron
    }

    /// What was not believed so far, and why.
    #[must_use]
    pub const fn counts(&self) -> Counts {
        Counts { unpaired: self.pairing.unpaired(), attitude: self.track.doubted(), ..self.counts }
    }

    /// The fixed numbers.
    #[must_use]
    pub const fn config(&self) -> &Config {
        &self.config
    }

    fn count(&mut self, fault: Fault) {
        let counter = match fault {
            Fault::Saturated => &mut self.counts.saturated,
            Fault::Clipped => &mut self.counts.clipped,
            Fault::Stuck => &mut self.counts.stuck,
            Fault::Spike => &mut self.counts.spikes,
        };
        *counter = counter.wrapping_add(1);
    }

    /// When the attitude of an instant is told: later with a calibration whose samples showed the reports to be older
    /// than they are taken for.
    fn told_at(&self, at: Timestamp) -> Timestamp {
        let latency_s = self.correction.calibration.as_ref().map_or(0.0, |(calibration, _)| calibration.latency_s);
        // The cast saturates, and takes what is no number to nothing.
        at.shifted_us((latency_s * 1e6) as i32)
    }

    fn attitude_at(&self, at: Timestamp) -> Result<Attitude, NoHeading> {
        match self.track.at(self.told_at(at)) {
            Lookup::Interpolated(attitude) | Lookup::Extrapolated(attitude) => Ok(attitude),
            Lookup::Frozen => Err(NoHeading::AttitudeFrozen),
            Lookup::Aligning => Err(NoHeading::AttitudeContradicted),
            Lookup::Missing | Lookup::Stale => Err(NoHeading::AttitudeStale),
        }
    }

    /// Whether the field of a reading can be told as that of a compass, by what became of its heading. What only an attitude
    /// is missing for, or an attitude contradicts, is judged by its strength.
    fn is_trusted(&self, at: Timestamp, field: Field<Sensor>, heading: &Result<Heading, NoHeading>) -> bool {
        match heading {
            // The latter is told as it is read, or not at all: that is the field's own affair.
            Ok(_) | Err(NoHeading::Uncalibrated) => true,
            Err(NoHeading::AttitudeStale | NoHeading::AttitudeFrozen | NoHeading::AttitudeContradicted) => {
                !self.is_field_blamed(at) && self.is_as_strong(field)
            }
            Err(_) => false,
        }
    }

    /// Whether the watch has seen, while there was an attitude, that the field is not as calibrated.
    fn is_field_blamed(&self, at: Timestamp) -> bool {
        match self.watch.adjustment().verdict {
            Err(NoHeading::FieldChanged) => true,
            Err(NoHeading::FieldDisturbed) => at.us_since(self.watched_at) <= DISTURBED_US,
            _ => false,
        }
    }

    /// Whether a field has the strength that it has by the calibration in force.
    fn is_as_strong(&self, field: Field<Sensor>) -> bool {
        let most = self.config.heading.max_total_deviation;
        let of_total = |calibration: &Calibration| calibration.apply(field).total_ut() / calibration.total_ut;
        self.in_force.as_ref().is_some_and(|(calibration, _)| (of_total(calibration) - 1.0).abs() <= most)
    }

    #[inline(never)]
    fn heading(
        &self,
        field: Field<Sensor>,
        current_a: Option<f32>,
        attitude: Result<Attitude, NoHeading>,
        turning: Option<&Turning>,
    ) -> Result<Heading, NoHeading> {
        let mut in_force = self.in_force.as_ref();
        let mut adjustment = self.watch.adjustment();
        if self.config.heading.believes_all() && adjustment.verdict.is_err() {
            // What is shown in any field is, in doubt, as it was calibrated.
            (in_force, adjustment) = (self.correction.calibration.as_ref(), &watch::Adjustment::NONE);
        }
        let (calibration, uncertainty) = in_force.ok_or(NoHeading::Uncalibrated)?;
        let motion = turning.map_or_else(Motion::default, |turning| turning.motion);
        let attitude = adjustment.attitude(attitude?, &motion);
        let config = self.config.heading;
        let believes_all = config.believes_all();
        let config = if self.correction.knows_inclination { config } else { config.of_any_inclination() };
        adjustment.verdict?;
        let heading = heading::heading(config, calibration, uncertainty, field, attitude)?
            .with_systematic(adjustment.variance_rad2)
            .with_more(calibration.current_variance_rad2(current_a));
        if believes_all || adjustment.agrees(self.watch.config(), heading, turning) {
            Ok(heading.turned_by(self.correction.align_deg))
        } else {
            Err(NoHeading::FieldDisturbed)
        }
    }
}
