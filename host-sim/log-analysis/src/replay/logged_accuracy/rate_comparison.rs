//! Error of the logged heading against the turn by the body rates, in which no compass has a part.
//!
//! In a window the difference between heading and integrated turn `g` is `e = c + b t + k g + d(heading) + noise`: the
//! window's heading at its start `c`, the offset of the rates `b` (of the flight, and its drift in the window), their
//! scale error `k`, and the deviation `d`, three harmonics of the heading. All are estimated by least squares with
//! priors; the error of the heading is `e - b t - k g` about its mean in the window.

use nalgebra::SVector;

use crate::least_squares::LeastSquares;
use crate::log::{HeadingIntegral, LoggedFlight, MAX_PITCH_RAD};
use crate::numbers::{mean, square};
use crate::replay::data_loss::measured_turns;
use crate::replay::flown_headings::HeadingSectors;
use crate::replay::row::ReplayRow;
use crate::score::{BAD_COMPASS_RMS_DEG, wrap_180};

/// Longest window, seconds: the drift of a micromachined gyro in it is below a degree.
const WINDOW_S: f64 = 60.0;
/// Shortest window, seconds.
const MIN_WINDOW_S: f64 = 10.0;
/// Turn in a window from which on it relates its headings to each other, degrees.
const MIN_TURN_DEG: f64 = 45.0;

/// Standard deviation of a difference averaged over a second, degrees: attitude errors in turns, and sensor noise.
const NOISE_DEG: f64 = 2.0;
/// Prior standard deviations of the rates' offset, deg/s, their scale error, and the harmonics of the deviation, degrees.
const PRIOR_SIGMAS: [f64; SHARED_UNKNOWNS] = [0.5, 0.02, 20.0, 20.0, 10.0, 10.0, 5.0, 5.0];
/// Standard deviation of the offset's drift from window to window, deg/s.
const OFFSET_DRIFT_DEG_S: f64 = 0.03;

/// Offset, scale error, and three harmonics of the deviation.
const SHARED_UNKNOWNS: usize = 8;
/// These, and the start and the drift of a window.
const UNKNOWNS: usize = SHARED_UNKNOWNS + 2;

/// A heading that swings by so much while the aircraft hardly turns is bad, degrees RMS: twice a bad compass's error,
/// since tilts and accelerations turn it, too.
const MIN_SWING_DEG: f64 = 2.0 * BAD_COMPASS_RMS_DEG;

/// The deviation's argument is the true heading, of which the first iteration has only the compass's.
const ITERATIONS: usize = 3;

/// Row of a window.
struct WindowRow {
    /// Time from the middle of the window, seconds.
    t_s: f64,
    /// Turn by the rates since the window's first row, degrees.
    turn_deg: f64,
    /// Heading less turn, unwrapped, degrees.
    difference_deg: f64,
}

/// Error of the heading as logged about its mean, degrees RMS, and the headings that turns relate to each other; none if
/// too little is logged, and without a turn unless the heading swings.
pub(super) fn error_by_rates(flight: &LoggedFlight, rows: &[ReplayRow]) -> Option<(f64, HeadingSectors)> {
    let windows = fit_windows(windows(rows, &measured_turns(flight)))?;
    let has_turned = windows.iter().any(FittedWindow::has_turned);
    // The mean error of a window is not known, and a window without a turn shows noise alone.
    let judged = || windows.iter().filter(|window| window.has_turned() || !has_turned);
    let row_count: usize = judged().map(|window| window.rows.len()).sum();
    let rms = |squares: &dyn Fn(&FittedWindow) -> f64| (judged().map(squares).sum::<f64>() / row_count as f64).sqrt();
    let rms_deg = rms(&|window| squares_about_mean(&window.errors_deg));
    let swing_deg = rms(&|window| excess_swing_squares(&window.rows));
    let sectors = judged().filter(|_| has_turned).flat_map(FittedWindow::headings_deg).collect();
    (has_turned || rms_deg.min(swing_deg) > MIN_SWING_DEG).then_some((rms_deg, sectors))
}

/// A window with its errors.
struct FittedWindow {
    rows: Vec<WindowRow>,
    /// Heading at the window's first row, degrees.
    start_deg: f64,
    /// Errors of the rows, from an unknown mean, degrees.
    errors_deg: Vec<f64>,
}

impl FittedWindow {
    fn has_turned(&self) -> bool {
        let turns = self.rows.iter().map(|row| row.turn_deg);
        turns.clone().fold(f64::MIN, f64::max) - turns.fold(f64::MAX, f64::min) >= MIN_TURN_DEG
    }

    fn headings_deg(&self) -> impl Iterator<Item = f64> + '_ {
        self.rows.iter().map(|row| self.start_deg + row.turn_deg)
    }
}

/// Least-squares fit of all windows; none without rows.
fn fit_windows(windows: Vec<Vec<WindowRow>>) -> Option<Vec<FittedWindow>> {
    let row_count: usize = windows.iter().map(Vec::len).sum();
    // Rows per second, of which each has its part of the information of a second.
    let duration_s: f64 = windows.iter().map(|window| window_duration_s(window)).sum();
    let weight = duration_s / row_count as f64 / square(NOISE_DEG);
    let start = |rows: Vec<WindowRow>| {
        let start_deg = mean(rows.iter().map(|row| row.difference_deg));
        FittedWindow { rows, start_deg, errors_deg: Vec::new() }
    };
    let mut fitted: Vec<FittedWindow> = windows.into_iter().map(start).collect();
    for _ in 0..ITERATIONS {
        let equations: Vec<_> = fitted.iter().map(|window| window_equations(window, weight)).collect();
        let shared = shared_unknowns(&equations)?;
        for (window, equations) in fitted.iter_mut().zip(&equations) {
            let [offset_deg, drift_deg_s] = local_unknowns(equations, &shared)?.into();
            let error_deg = |row: &WindowRow| {
                row.difference_deg - offset_deg - (shared[0] + drift_deg_s) * row.t_s - shared[1] * row.turn_deg
            };
            (window.start_deg, window.errors_deg) = (offset_deg, window.rows.iter().map(error_deg).collect());
        }
    }
    (row_count > 0).then_some(fitted)
}

fn squares_about_mean(values: &[f64]) -> f64 {
    let mean = mean(values.iter().copied());
    values.iter().map(|value| square(value - mean)).sum()
}

/// Sum of squares of a compass's heading about its mean, less that of the turn: what a rate that is off cannot explain.
fn excess_swing_squares(window: &[WindowRow]) -> f64 {
    let headings_deg: Vec<f64> = window.iter().map(|row| row.difference_deg + row.turn_deg).collect();
    let turns_deg: Vec<f64> = window.iter().map(|row| row.turn_deg).collect();
    (squares_about_mean(&headings_deg) - squares_about_mean(&turns_deg)).max(0.0)
}

/// Usable rows in windows without a gap of the rates.
fn windows(rows: &[ReplayRow], turns: &HeadingIntegral) -> Vec<Vec<WindowRow>> {
    let usable = rows.iter().filter(|row| row.is_usable && row.attitude.pitch_rad.abs() <= MAX_PITCH_RAD);
    // With the part of the flight without a gap.
    let turned: Vec<(usize, WindowRow)> = usable.filter_map(|row| turned_row(row, turns)).collect();
    let mut remaining = turned.as_slice();
    let mut windows = Vec::new();
    while let Some((part, first)) = remaining.first() {
        let is_same = |(other, row): &&(usize, WindowRow)| other == part && row.t_s - first.t_s < WINDOW_S;
        let (window, later) = remaining.split_at(remaining.iter().take_while(is_same).count());
        windows.push(window_rows(window));
        remaining = later;
    }
    windows.retain(|window| window_duration_s(window) >= MIN_WINDOW_S);
    windows
}

/// Row with its time, turn and difference from any origin.
fn turned_row(row: &ReplayRow, turns: &HeadingIntegral) -> Option<(usize, WindowRow)> {
    let (part, turn_rad) = turns.part_and_heading_rad(row.t_s)?;
    let turn_deg = turn_rad.to_degrees();
    let difference_deg = row.logged_heading_deg() - turn_deg;
    difference_deg.is_finite().then_some((part, WindowRow { t_s: row.t_s, turn_deg, difference_deg }))
}

fn window_rows(window: &[(usize, WindowRow)]) -> Vec<WindowRow> {
    let [Some((_, first)), Some((_, last))] = [window.first(), window.last()] else { return Vec::new() };
    let middle_s = first.t_s.midpoint(last.t_s);
    let mut last_deg = 0.0;
    let rows = window.iter().map(|(_, row)| {
        last_deg += wrap_180(row.difference_deg + first.turn_deg - last_deg);
        WindowRow { t_s: row.t_s - middle_s, turn_deg: row.turn_deg - first.turn_deg, difference_deg: last_deg }
    });
    rows.collect()
}

fn window_duration_s(window: &[WindowRow]) -> f64 {
    window.first().zip(window.last()).map_or(0.0, |(first, last)| last.t_s - first.t_s)
}

/// Equations of a window.
fn window_equations(window: &FittedWindow, weight: f64) -> LeastSquares<UNKNOWNS> {
    let mut prior_sigmas = [f64::INFINITY; UNKNOWNS];
    prior_sigmas[SHARED_UNKNOWNS + 1] = OFFSET_DRIFT_DEG_S;
    let mut equations = LeastSquares::with_prior_sigmas(prior_sigmas);
    for row in &window.rows {
        let heading_rad = (window.start_deg + row.turn_deg).to_radians();
        let [first, second, third] = [1.0, 2.0, 3.0].map(|harmonic| libm::sincos(harmonic * heading_rad));
        let ((sin, cos), (sin2, cos2), (sin3, cos3)) = (first, second, third);
        let derivatives = [row.t_s, row.turn_deg, sin, cos, sin2, cos2, sin3, cos3, 1.0, row.t_s];
        equations.add_row(&derivatives.into(), row.difference_deg, weight);
    }
    equations
}

/// Start, degrees, and drift, deg/s, of a window.
fn local_unknowns(
    LeastSquares { normal, right_side, .. }: &LeastSquares<UNKNOWNS>,
    shared: &SVector<f64, SHARED_UNKNOWNS>,
) -> Option<SVector<f64, 2>> {
    let local_inverse = normal.fixed_view::<2, 2>(SHARED_UNKNOWNS, SHARED_UNKNOWNS).try_inverse()?;
    let by_shared = normal.fixed_view::<2, SHARED_UNKNOWNS>(SHARED_UNKNOWNS, 0) * shared;
    Some(local_inverse * (right_side.fixed_rows::<2>(SHARED_UNKNOWNS) - by_shared))
}

/// Shared unknowns, after elimination of the windows' own.
fn shared_unknowns(windows: &[LeastSquares<UNKNOWNS>]) -> Option<SVector<f64, SHARED_UNKNOWNS>> {
    let mut all = LeastSquares::with_prior_sigmas(PRIOR_SIGMAS);
    for LeastSquares { normal, right_side, .. } in windows {
        let cross = normal.fixed_view::<SHARED_UNKNOWNS, 2>(0, SHARED_UNKNOWNS);
        let eliminated = cross * normal.fixed_view::<2, 2>(SHARED_UNKNOWNS, SHARED_UNKNOWNS).try_inverse()?;
        all.normal += normal.fixed_view::<SHARED_UNKNOWNS, SHARED_UNKNOWNS>(0, 0) - eliminated * cross.transpose();
        let local_side = right_side.fixed_rows::<2>(SHARED_UNKNOWNS);
        all.right_side += right_side.fixed_rows::<SHARED_UNKNOWNS>(0) - eliminated * local_side;
    }
    all.solve()
}
