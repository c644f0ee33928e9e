//! Sectors of heading that were flown.

use crate::log::LoggedFlight;
use crate::replay::row::ReplayRow;

/// Longest gap of the autopilot's yaw by which headings are counted, seconds.
const MAX_YAW_GAP_S: f64 = 1.5;

/// Sectors of a turn, of 30 deg each.
const SECTOR_COUNT: usize = 12;
/// Minimum number of rows in a sector that counts as flown: half a second.
const MIN_ROWS_PER_SECTOR: usize = 5;
/// Minimum number of sectors flown, to judge a compass on them: errors exclude their mean, and a straight flight may
/// touch two.
const MIN_JUDGED_SECTORS: usize = 3;
/// Minimum number of sectors flown, to conclude from them on a fit, or on the compass's north.
const MIN_COVERED_SECTORS: usize = 4;

/// Number of rows in each sector of heading.
#[derive(Clone, Copy, Debug, Default)]
pub struct HeadingSectors {
    row_counts: [usize; SECTOR_COUNT],
}

impl HeadingSectors {
    /// Number of sectors flown, of twelve.
    pub fn flown_count(&self) -> usize {
        self.row_counts.iter().filter(|row_count| **row_count >= MIN_ROWS_PER_SECTOR).count()
    }

    /// Whether a compass can be judged on the headings flown.
    pub fn are_judged(&self) -> bool {
        self.flown_count() >= MIN_JUDGED_SECTORS
    }

    /// Whether the headings flown show more than the compass's error on them.
    pub fn suffice(&self) -> bool {
        self.flown_count() >= MIN_COVERED_SECTORS
    }
}

impl FromIterator<f64> for HeadingSectors {
    /// Counts headings in degrees.
    fn from_iter<T: IntoIterator<Item = f64>>(headings_deg: T) -> Self {
        let mut sectors = Self::default();
        for heading_deg in headings_deg {
            let sector = heading_deg.rem_euclid(360.0) / 360.0 * SECTOR_COUNT as f64;
            sectors.row_counts[sector as usize % SECTOR_COUNT] += 1;
        }
        sectors
    }
}

/// Headings flown, by the autopilot's yaw; without one, by the compass as logged.
pub(super) fn yaw_sectors(flight: &LoggedFlight, rows: &[ReplayRow]) -> HeadingSectors {
    let yaw_deg = |row: &ReplayRow| {
        let [_, _, yaw_rad] = flight.attitude.interpolate_angles(row.t_s, MAX_YAW_GAP_S)?;
        yaw_rad.is_finite().then(|| f64::from(yaw_rad.to_degrees()))
    };
    let usable = rows.iter().filter(|row| row.is_usable);
    usable.map(|row| yaw_deg(row).unwrap_or_else(|| row.logged_heading_deg())).collect()
}
