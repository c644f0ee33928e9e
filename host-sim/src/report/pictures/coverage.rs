//! What was flown, by heading and tilt, and what was not.

use super::super::model::{Moment, Swung};
use super::super::svg::{At, Shape, Svg};
use super::super::text::number;
use super::{Key, Picture, legend};

/// Sectors of the heading, each about its number.
const SECTORS: usize = 12;

/// A row of the picture: name, and whether a tilt belongs to it.
type Row = (&'static str, fn(&Moment) -> bool);

/// Bank, then pitch.
const ROWS: [Row; 8] = [
    ("30 and more right", |moment| moment.roll_deg >= 30.0),
    ("10 to 30 right", |moment| (10.0..30.0).contains(&moment.roll_deg)),
    ("wings level", |moment| moment.roll_deg.abs() < 10.0),
    ("10 to 30 left", |moment| moment.roll_deg <= -10.0 && moment.roll_deg > -30.0),
    ("30 and more left", |moment| moment.roll_deg <= -30.0),
    ("10 and more up", |moment| moment.pitch_deg >= 10.0),
    ("nose level", |moment| moment.pitch_deg.abs() < 10.0),
    ("10 and more down", |moment| moment.pitch_deg <= -10.0),
];

const BANKS: usize = 5;

/// A field of the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Cell {
    flown_s: f64,
    fitted: usize,
}

impl Cell {
    fn is_missing(self) -> bool {
        self.flown_s <= 0.0 && self.fitted == 0
    }
}

/// Whether it is one that the field was seen in, and that counts.
fn counts(moment: &Moment) -> bool {
    moment.is_usable && moment.level_ut[0].is_some()
}

fn cells(swung: &Swung) -> [[Cell; SECTORS]; ROWS.len()] {
    let mut cells = [[Cell::default(); SECTORS]; ROWS.len()];
    // A moment stands for the time to the next, as long as that is no gap.
    let nexts = swung.moments.iter().skip(1).map(|next| next.at_s).chain(swung.moments.last().map(|last| last.at_s));
    for (moment, next_s) in swung.moments.iter().zip(nexts).filter(|(moment, _)| counts(moment)) {
        let Some(heading_deg) = moment.heading_deg.filter(|deg| deg.is_finite()) else { continue };
        let sector = (heading_deg / 30.0).round().rem_euclid(SECTORS as f64) as usize;
        for (row, (_, belongs)) in cells.iter_mut().zip(ROWS) {
            if let Some(cell) = row.get_mut(sector).filter(|_| belongs(moment)) {
                cell.flown_s += (next_s - moment.at_s).clamp(0.0, 1.0);
                cell.fitted += usize::from(moment.is_fitted);
            }
        }
    }
    cells
}

/// The picture.
pub fn coverage(swung: &Swung) -> Picture {
    const LEFT: f64 = 142.0;
    const CELL: At = [40.0, 26.0];
    let cells = cells(swung);
    let mut svg = Svg::new(LEFT + CELL[0] * SECTORS as f64 + 16.0, 346.0);
    let knows = swung.knows_fitted;
    let number_is = if knows { "collected and fitted to: how many" } else { "flown: seconds" };
    let mut items = vec![(Key::Area("cell used"), number_is)];
    if knows {
        items.push((Key::Area("cell flown"), "flown, not collected"));
    }
    items.push((Key::Area("missed"), "not flown"));
    let top = legend(&mut svg, [16.0, 8.0], 600.0, &items) + 14.0;
    svg.text("name", [16.0, top - 4.0], "bank, deg");
    for (row, ((name, _), cells)) in ROWS.iter().zip(&cells).enumerate() {
        let gap = if row < BANKS { 0.0 } else { 22.0 };
        let y = top + CELL[1] * row as f64 + gap;
        if row == BANKS {
            svg.text("name", [16.0, y - 4.0], "pitch, deg");
        }
        svg.text("tick end", [LEFT - 6.0, y + 17.0], name);
        for (sector, cell) in cells.iter().enumerate() {
            draw(&mut svg, [LEFT + CELL[0] * sector as f64, y], CELL, *cell, knows);
        }
    }
    let bottom = top + CELL[1] * ROWS.len() as f64 + 22.0;
    for sector in 0..SECTORS {
        svg.text("tick mid", [LEFT + CELL[0] * (sector as f64 + 0.5), bottom + 16.0], &(30 * sector).to_string());
    }
    svg.text("name mid", [LEFT + CELL[0] * SECTORS as f64 / 2.0, bottom + 34.0], "heading, deg");
    Picture { svg, title: "What was flown".to_owned(), words: words(swung, &cells), is_wide: true }
}

fn draw(svg: &mut Svg, [x, y]: At, [width, height]: At, cell: Cell, knows_fitted: bool) {
    if cell.is_missing() {
        svg.rect("missed", [x + 2.0, y + 2.0], [width - 4.0, height - 4.0]);
        svg.points("p2 faint", Shape::Diamond, 2.0, [[x + width / 2.0, y + height / 2.0]]);
        return;
    }
    let is_used = !knows_fitted || cell.fitted > 0;
    svg.rect(if is_used { "cell used" } else { "cell flown" }, [x, y], [width, height]);
    let count = if knows_fitted { cell.fitted as f64 } else { cell.flown_s.ceil() };
    if is_used {
        svg.text("count mid", [x + width / 2.0, y + height / 2.0 + 4.0], &number(count, 0));
    }
}

/// Headings that were missing in each row, in words.
fn words(swung: &Swung, cells: &[[Cell; SECTORS]; ROWS.len()]) -> String {
    let mut words = Vec::new();
    for ((name, _), row) in ROWS.iter().zip(cells) {
        let missing: Vec<String> = row
            .iter()
            .enumerate()
            .filter(|(_, cell)| cell.is_missing())
            .map(|(sector, _)| (30 * sector).to_string())
            .collect();
        words.push(match missing.len() {
            0 => format!("{name}: all headings flown"),
            SECTORS => format!("{name}: none flown"),
            _ => format!("{name}: not flown {}", missing.join(", ")),
        });
    }
    let advice = swung.advice.as_ref().map_or_else(String::new, |advice| format!(" What would mend most: {advice}."));
    format!("{}. Not all of it is needed.{advice}", words.join("; "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_flown_and_what_was_missing_are_told_apart() {
        let moment = |at_s: f64, heading_deg: f64, roll_deg: f64, is_fitted: bool| Moment {
            at_s,
            heading_deg: Some(heading_deg),
            roll_deg,
            level_ut: [Some([20.0, 0.0]), None],
            is_usable: true,
            is_fitted,
            ..Moment::default()
        };
        let moments =
            vec![moment(0.0, 350.0, 30.0, true), moment(0.5, 16.0, -12.0, false), moment(60.0, 16.0, 0.0, true)];
        let swung = Swung { moments, knows_fitted: true, ..Swung::default() };
        let cells = cells(&swung);
        // North at 30 right; 30 deg at 10 to 30 left for no longer than a second; the last has no time, but counts.
        assert_eq!(cells[0][0], Cell { flown_s: 0.5, fitted: 1 });
        assert_eq!(cells[3][1], Cell { flown_s: 1.0, fitted: 0 });
        assert_eq!(cells[2][1], Cell { flown_s: 0.0, fitted: 1 });
        assert_eq!(
            cells.as_flattened().iter().filter(|cell| **cell != Cell::default()).count(),
            5,
            "three, and their pitch"
        );
        let picture = coverage(&swung);
        let drawn = picture.svg.inline("p", "", "");
        assert_eq!(drawn.matches(r#"class="missed""#).count(), 8 * 12 - 5 + 1);
        assert!(
            picture.words.contains("10 and more up: none flown")
                && picture.words.contains("wings level: not flown 0, 60"),
            "{}",
            picture.words
        );
    }
}
