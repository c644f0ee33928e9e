//! World Magnetic Model WMM2025: the field of the Earth's core and its secular variation, by the crate
//! `world_magnetic_model`.
//!
//! Source: Chulliat et al., *The US/UK World Magnetic Model for 2025-2030: Technical Report*, NOAA 2024
//! (doi:10.25923/prbc-s316). Errors by its error model (section 3.4), crustal field included, 1 sigma: inclination
//! 0.20 deg, field strength 0.14 uT, declination `sqrt(0.26^2 + (5.4 uT / H)^2)` deg, `H` being the horizontal field.

use world_magnetic_model::GeomagneticField;
use world_magnetic_model::uom::si::angle::degree;
use world_magnetic_model::uom::si::f32::{Angle, Length};
use world_magnetic_model::uom::si::length::meter;
use world_magnetic_model::uom::si::magnetic_flux_density::nanotesla;

use super::{Date, Position};
use crate::trig;

/// Earth's magnetic field at a position and date.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EarthField {
    /// Declination, degrees, east positive; `None` below 2 uT of horizontal field, the model's blackout zone around the
    /// magnetic poles.
    pub declination_deg: Option<f32>,
    /// Inclination, degrees, positive down.
    pub inclination_deg: f32,
    /// Field strength, microtesla.
    pub total_ut: f32,
}

/// Name of the model.
pub const MODEL_NAME: &str = "WMM2025";

/// Limit of the blackout zone, horizontal nanotesla.
const MIN_HORIZONTAL_NT: f32 = 2_000.0;

/// Validity of the model on a date.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModelValidity {
    /// Before 2025: the clock is wrong, since the firmware is younger. Not used.
    TooEarly,
    /// 2025 to 2029, the model's intended period.
    Valid,
    /// 2030 to 2034. Still used, so that true heading does not disappear on a New Year's Day: WMM2020 extrapolated to
    /// 2030 differs from WMM2025 by 0.31 deg of declination RMS (95 %: 0.6 deg) where `H` is at least 6 uT, about the
    /// error of a valid model.
    Extrapolated,
    /// From 2035. Not used.
    TooOld,
}

/// 2025-01-01, 2029-12-31 and 2035-01-01, days since 1970-01-01.
const FIRST_DAY: u16 = 20_089;
const LAST_DAY: u16 = 21_914;
const TOO_OLD: u16 = 23_741;

impl ModelValidity {
    /// Validity on a date.
    #[must_use]
    pub const fn on_date(day: Date) -> Self {
        match day.days_since_1970() {
            ..FIRST_DAY => Self::TooEarly,
            FIRST_DAY..=LAST_DAY => Self::Valid,
            ..TOO_OLD => Self::Extrapolated,
            TOO_OLD.. => Self::TooOld,
        }
    }

    /// Whether the model is used.
    #[must_use]
    pub const fn is_used(self) -> bool {
        matches!(self, Self::Valid | Self::Extrapolated)
    }
}

impl EarthField {
    /// Computes the model field; `None` on a date without a usable model.
    ///
    /// The height above sea level is used as ellipsoidal height: they differ by at most 0.1 km, the field by 0.005 %.
    #[must_use]
    pub fn from_model(place: Position, day: Date) -> Option<Self> {
        let [north, east, down] = components_nt(place, day)?;
        let horizontal = trig::hypot(north, east);
        let has_declination = horizontal >= MIN_HORIZONTAL_NT;
        Some(Self {
            declination_deg: has_declination.then(|| libm::atan2f(east, north).to_degrees()),
            inclination_deg: libm::atan2f(down, horizontal).to_degrees(),
            total_ut: trig::hypot(horizontal, down) / 1_000.0,
        })
    }
}

/// North, east and down components, nanotesla. The model is linear in time (report, eq. 9), and the crate ends in 2029:
/// later dates continue the line through the first and the last day.
fn components_nt(place: Position, day: Date) -> Option<[f32; 3]> {
    let days = day.days_since_1970();
    match ModelValidity::on_date(day) {
        ModelValidity::Valid => modelled_nt(place, day),
        ModelValidity::Extrapolated => {
            let [first, last] = [modelled_nt(place, Date(FIRST_DAY))?, modelled_nt(place, Date(LAST_DAY))?];
            let periods = f32::from(days - LAST_DAY) / f32::from(LAST_DAY - FIRST_DAY);
            Some(core::array::from_fn(|axis| last[axis] + periods * (last[axis] - first[axis])))
        }
        ModelValidity::TooEarly | ModelValidity::TooOld => None,
    }
}

/// North, east and down components on a day of the model's period, nanotesla.
#[inline(never)] // The crate's tables of sines and functions leave the stack before the next call.
fn modelled_nt(place: Position, day: Date) -> Option<[f32; 3]> {
    let [latitude, longitude] = [place.latitude_deg, place.longitude_deg].map(Angle::new::<degree>);
    let field = GeomagneticField::new(Length::new::<meter>(place.height_m), latitude, longitude, day.calendar()).ok()?;
    Some([field.x(), field.y(), field.z()].map(|component| component.get::<nanotesla>()))
}

#[cfg(test)]
mod tests;
