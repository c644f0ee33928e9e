//! Joint fit of the correction and of a change, of hard iron or of the sensor, to the rows on both sides of a time.
//!
//! The readings `m'` of one side are related to the readings `m` that the sensor of the other side would give by
//! `m = g * (m' - o)`, with a gain per axis `g` and an offset `o`; a hypothesis frees some of these six numbers. With
//! the correction `h = W (m - b - c I)` of the unchanged side, all fields have one strength `F` and one vertical
//! component `F sin I`. Levenberg-Marquardt with the weights of Student's t distribution, whose scale is estimated for
//! each side and residual.

use nalgebra::{DMatrix, Matrix3, SMatrix, SVector, Vector3};

use crate::least_squares::LeastSquares;
use crate::log::FieldCorrection;
use crate::numbers::{SIGMAS_PER_MEDIAN, median, square};
use crate::replay::row::ReplayRow;

/// Number of unknowns: `W`, `b`, motor-current interference, strength, vertical component, gains, offset.
const UNKNOWNS: usize = 23;
/// Index of the first component of hard iron among the unknowns; those of the other groups.
const HARD_IRON: usize = 9;
const MOTOR_CURRENT: usize = 12;
const STRENGTH: usize = 15;
const VERTICAL: usize = 16;
const GAIN: usize = 17;
const OFFSET: usize = 20;

/// Number of unknowns of a fit without motor current and change: `W`, `b`, strength, vertical component.
pub(super) const FIT_UNKNOWNS: usize = 14;

/// Number of groups of residuals: strength and vertical component, of each side.
const GROUPS: usize = 4;

/// Degrees of freedom of the residuals' t distribution: tails as of attitude errors in manoeuvres.
const T_FREEDOM: f64 = 4.0;

/// Smallest scale of residuals, microtesla: the resolution of a log.
const MIN_SCALE_UT: f64 = 0.05;

/// Prior standard deviations: of a gain of all axes, of a gain or sign of one of three axes, and of a sensor's offset,
/// microtesla.
const GAIN_SIGMA: f64 = 0.3;
const AXIS_GAIN_SIGMA: f64 = 3.0;
const REGISTER_OFFSET_SIGMA_UT: f64 = 50.0;

/// Smallest prior of hard iron, microtesla: smaller changes hardly affect headings.
const MIN_HARD_IRON_UT: f64 = 1.0;

/// Number of candidate times of a step of hard iron.
const CANDIDATE_TIMES: usize = 120;

const MAX_ITERATIONS: usize = 30;
/// Relative decrease of the objective at convergence.
const CONVERGED_DECREASE: f64 = 1e-5;

/// Change of the field's readings between two sides: the unknowns that are estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Hypothesis {
    /// No change.
    Unchanged,
    /// Hard iron: an offset.
    HardIron,
    /// One gain of all axes.
    Gain,
    /// The gain of one axis, or its sign.
    AxisGain(usize),
    /// Gain per axis, and an offset.
    Registers,
}

impl Hypothesis {
    /// Changes that differ between axes.
    pub const OF_AXES: [Self; 4] = [Self::AxisGain(0), Self::AxisGain(1), Self::AxisGain(2), Self::Registers];

    /// Whether the sensor changes.
    pub fn is_of_sensor(self) -> bool {
        !matches!(self, Self::Unchanged | Self::HardIron)
    }

    /// Vectors of unknowns that the hypothesis frees in addition to the correction's.
    fn freed_unknowns(self) -> Vec<SVector<f64, UNKNOWNS>> {
        let single = |index: usize| SVector::from_fn(|i, _| if i == index { 1.0 } else { 0.0 });
        match self {
            Self::Unchanged => Vec::new(),
            Self::HardIron => (OFFSET..UNKNOWNS).map(single).collect(),
            Self::Gain => vec![SVector::from_fn(|i, _| if (GAIN..OFFSET).contains(&i) { 1.0 } else { 0.0 })],
            Self::AxisGain(axis) => vec![single(GAIN + axis)],
            Self::Registers => (GAIN..UNKNOWNS).map(single).collect(),
        }
    }

    /// Prior standard deviations of the freed unknowns. Hard iron of any size is equally likely in all directions: its
    /// prior is the fitted size, and an exact parallel to the reading is a coincidence.
    fn prior_sigmas(self, offset_size_ut: f64) -> Vec<f64> {
        match self {
            Self::Unchanged => Vec::new(),
            Self::HardIron => vec![offset_size_ut.max(MIN_HARD_IRON_UT); 3],
            Self::Gain => vec![GAIN_SIGMA],
            Self::AxisGain(_) => vec![AXIS_GAIN_SIGMA],
            Self::Registers => [[AXIS_GAIN_SIGMA; 3], [REGISTER_OFFSET_SIGMA_UT; 3]].concat(),
        }
    }
}

/// Row for the fit.
#[derive(Clone, Copy)]
pub(super) struct FitRow {
    raw_ut: Vector3<f64>,
    down: Vector3<f64>,
    current_a: f64,
    /// Whether the row is on the side whose readings the hypothesis transforms.
    pub is_changed: bool,
}

impl FitRow {
    pub fn new(row: &ReplayRow, is_changed: bool) -> Self {
        Self {
            raw_ut: row.raw_field.ut.map(f64::from),
            down: row.down_in_body(),
            current_a: row.current_a.map_or(0.0, f64::from),
            is_changed,
        }
    }
}

/// Scales of the residuals, microtesla, by group.
pub(super) type Scales = [f64; GROUPS];

/// Group of a residual: 0 strength, 1 vertical component; of the changed side plus 2.
fn group_of(is_changed: bool, residual_index: usize) -> usize {
    2 * usize::from(is_changed) + residual_index
}

/// Estimate of all unknowns.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChangeFit {
    correction: FieldCorrection,
    strength_ut: f64,
    vertical_ut: f64,
    /// Gains and offset that restore the readings of the changed side.
    pub gain: Vector3<f64>,
    pub offset_ut: Vector3<f64>,
    /// A measurement of the offset and the standard deviation of its components, microtesla.
    measured_offset: Option<(Vector3<f64>, f64)>,
}

impl ChangeFit {
    /// Estimate without a change, by a correction that fits the unchanged rows.
    pub fn from_correction(rows: &[FitRow], correction: &FieldCorrection) -> Self {
        let mut fit = Self {
            correction: *correction,
            strength_ut: 0.0,
            vertical_ut: 0.0,
            gain: Vector3::repeat(1.0),
            offset_ut: Vector3::zeros(),
            measured_offset: None,
        };
        let medians = [0, 1].map(|residual_index| {
            median(rows.iter().filter(|row| !row.is_changed).map(|row| fit.residuals_ut(row)[residual_index]))
        });
        [fit.strength_ut, fit.vertical_ut] = medians;
        fit
    }

    /// The estimate with another change.
    pub fn with_change(&self, gain: Vector3<f64>, offset_ut: Vector3<f64>) -> Self {
        Self { gain, offset_ut, ..*self }
    }

    /// The estimate with the gains and the offset that restore readings which another correction fits; none if that
    /// is singular.
    pub fn with_other(&self, other: &FieldCorrection) -> Option<Self> {
        let gain = (self.correction.matrix.try_inverse()? * other.matrix).diagonal();
        let offset_ut = other.hard_iron_ut - self.correction.hard_iron_ut.component_div(&gain);
        gain.iter().all(|axis| axis.abs() > 1e-3).then(|| self.with_change(gain, offset_ut))
    }

    /// The estimate with a measurement of the offset and its standard deviation, microtesla.
    pub fn with_measured_offset(&self, measured_offset: (Vector3<f64>, f64)) -> Self {
        Self { measured_offset: Some(measured_offset), ..*self }
    }

    /// Whether the offset is measured.
    pub fn is_measured(&self) -> bool {
        self.measured_offset.is_some()
    }

    /// The estimate with the difference of hard iron to that of another correction.
    pub fn with_other_iron(&self, other: &FieldCorrection) -> Self {
        self.with_change(Vector3::repeat(1.0), other.hard_iron_ut - self.correction.hard_iron_ut)
    }

    /// The estimate with the gains and the offset that restore the vertical component of the changed rows, which is
    /// linear in the gains and in the product of gain and offset; none without a solution.
    pub fn with_linear_change(&self, rows: &[FitRow]) -> Option<Self> {
        let mut fit = LeastSquares::with_prior_sigmas([1.0; 6]);
        // Gains are about one.
        fit.right_side.fixed_rows_mut::<3>(0).fill(1.0);
        for row in rows.iter().filter(|row| row.is_changed) {
            let by_raw = self.correction.matrix.transpose() * row.down;
            let iron_ut = self.correction.hard_iron_ut + self.correction.motor_ut_per_a * row.current_a;
            let derivatives = SVector::from_fn(|i, _| if i < 3 { by_raw[i] * row.raw_ut[i] } else { -by_raw[i - 3] });
            fit.add_row(&derivatives, self.vertical_ut + by_raw.dot(&iron_ut), 1.0);
        }
        let solved = fit.solve()?;
        let (gain, product_ut) = (solved.fixed_rows::<3>(0).into_owned(), solved.fixed_rows::<3>(3).into_owned());
        gain.iter().all(|axis| axis.abs() > 1e-3).then(|| self.with_change(gain, product_ut.component_div(&gain)))
    }

    /// Separate fits of the correction to the unchanged and to the changed rows, the second one started from `other`.
    pub fn fitted_separately(&self, rows: &[FitRow], other: Option<&FieldCorrection>) -> [Self; 2] {
        [false, true].map(|is_changed| {
            let side: Vec<FitRow> = rows
                .iter()
                .filter(|row| row.is_changed == is_changed)
                .map(|row| FitRow { is_changed: false, ..*row })
                .collect();
            let starts = [Some(&self.correction), other.filter(|_| is_changed)].into_iter().flatten();
            let fits = starts.map(|start| Self::from_correction(&side, start).fitted(&side, Hypothesis::Unchanged));
            fits.min_by(|a, b| a.objective(&side).total_cmp(&b.objective(&side))).unwrap_or(*self)
        })
    }

    /// Negative log-likelihood with estimated scales.
    pub fn objective(&self, rows: &[FitRow]) -> f64 {
        let scales = self.scales_ut(rows);
        let logs =
            rows.iter().map(|row| [0, 1].map(|i| libm::log(scales[group_of(row.is_changed, i)])).iter().sum::<f64>());
        self.negative_log_likelihood(rows, &scales) + logs.sum::<f64>()
    }

    fn raw_less_iron_ut(&self, row: &FitRow) -> Vector3<f64> {
        let raw_ut = if row.is_changed { self.gain.component_mul(&(row.raw_ut - self.offset_ut)) } else { row.raw_ut };
        raw_ut - self.correction.hard_iron_ut - self.correction.motor_ut_per_a * row.current_a
    }

    /// Residuals of strength and vertical component, microtesla.
    fn residuals_ut(&self, row: &FitRow) -> [f64; 2] {
        let field_ut = self.correction.matrix * self.raw_less_iron_ut(row);
        [field_ut.norm() - self.strength_ut, row.down.dot(&field_ut) - self.vertical_ut]
    }

    /// Robust standard deviations of the residuals.
    pub fn scales_ut(&self, rows: &[FitRow]) -> Scales {
        std::array::from_fn(|group| {
            let (is_changed, residual_index) = (group >= 2, group % 2);
            let residuals_ut = rows
                .iter()
                .filter(|row| row.is_changed == is_changed)
                .map(|row| self.residuals_ut(row)[residual_index].abs());
            (SIGMAS_PER_MEDIAN * median(residuals_ut)).max(MIN_SCALE_UT)
        })
    }

    /// Negative log-likelihood of independent residuals of given scales, up to a constant.
    pub fn negative_log_likelihood(&self, rows: &[FitRow], scales: &Scales) -> f64 {
        let of_row = |row: &FitRow| -> f64 {
            let residuals_ut = self.residuals_ut(row);
            let of_residual = |i: usize| {
                let normalised = residuals_ut[i] / scales[group_of(row.is_changed, i)];
                0.5 * (T_FREEDOM + 1.0) * libm::log(1.0 + square(normalised) / T_FREEDOM)
            };
            of_residual(0) + of_residual(1)
        };
        rows.iter().map(of_row).sum()
    }

    /// Median of the absolute residuals, microtesla.
    pub fn scatter_ut(&self, rows: &[FitRow]) -> f64 {
        median(rows.iter().flat_map(|row| self.residuals_ut(row).map(f64::abs)))
    }

    /// Index of the first row after the most likely time of the change, at least `margin` rows from both ends. `earlier`
    /// are all rows with the side of the earlier ones.
    pub fn likeliest_division(&self, earlier: &[FitRow], scales: &Scales, margin: usize) -> Option<usize> {
        let mut sum = 0.0;
        let sums = earlier.iter().enumerate().map(|(i, row)| {
            let of_earlier = self.negative_log_likelihood(&[*row], scales);
            let on_other_side = FitRow { is_changed: !row.is_changed, ..*row };
            let of_later = self.negative_log_likelihood(&[on_other_side], scales);
            let sum_before = sum;
            sum += of_earlier - of_later;
            (i, sum_before)
        });
        let is_possible = |i: usize| i >= margin && earlier.len() - i >= margin;
        sums.filter(|(i, _)| is_possible(*i)).min_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(i, _)| i)
    }

    /// Index of the first row after a step of hard iron that reduces the linearised residuals of unchanged rows most, at
    /// least `margin` rows from both ends.
    pub fn linearised_step(&self, rows: &[FitRow], margin: usize) -> Option<usize> {
        let scales = self.scales_ut(rows);
        let block_length = rows.len().div_ceil(CANDIDATE_TIMES + 1).max(1);
        let blocks: Vec<Equations> =
            rows.chunks(block_length).map(|block| self.data_equations(block, &scales)).collect();
        let information = Equations { normal: SMatrix::from_diagonal(&self.prior_information()), ..Equations::zeros() };
        let all = blocks.iter().fold(information, |sum, block| sum.plus(block));
        let mut after = Equations::zeros();
        let mut best: Option<(usize, f64)> = None;
        for (block_index, block) in blocks.iter().enumerate().rev() {
            after = after.plus(block);
            let index = block_index * block_length;
            let is_possible = index >= margin && rows.len() - index >= margin;
            let reduction = all.with_step(&after).reduction().filter(|_| is_possible);
            if let Some(reduction) = reduction.filter(|reduction| best.is_none_or(|(_, most)| *reduction > most)) {
                best = Some((index, reduction));
            }
        }
        best.map(|(index, _)| index)
    }

    /// Corrections of the unchanged and of the changed side, by a fit of hard iron.
    pub fn corrections_of_sides(&self) -> [FieldCorrection; 2] {
        let changed_ut = self.correction.hard_iron_ut + self.offset_ut;
        [self.correction, FieldCorrection { hard_iron_ut: changed_ut, ..self.correction }]
    }

    /// The offset in the corrected field, microtesla.
    pub fn corrected_offset_ut(&self) -> Vector3<f64> {
        self.correction.matrix * self.offset_ut
    }

    /// Horizontal component of the Earth's field, microtesla.
    pub fn horizontal_ut(&self) -> f64 {
        (square(self.strength_ut) - square(self.vertical_ut)).max(1.0).sqrt()
    }

    /// Standard deviations of the offset of hard iron, microtesla, of residuals of which `correlated_rows` successive ones
    /// count as one.
    pub fn offset_sigma_ut(&self, rows: &[FitRow], correlated_rows: f64) -> Option<Vector3<f64>> {
        let information = self.information(rows, Hypothesis::HardIron, &self.scales_ut(rows), correlated_rows);
        let covariance = information.cholesky()?.inverse();
        Some(Vector3::from_fn(|axis, _| covariance[(GAIN + axis, GAIN + axis)].max(0.0).sqrt()))
    }

    /// Information of the rows, of which `correlated_rows` successive ones count as one, and of the priors about the
    /// unknowns of a hypothesis.
    fn information(
        &self,
        rows: &[FitRow],
        hypothesis: Hypothesis,
        scales: &Scales,
        correlated_rows: f64,
    ) -> DMatrix<f64> {
        let free = free_directions(hypothesis);
        let Equations { normal, .. } = self.normal_equations(rows, scales, self);
        let mut information = free.transpose() * normal * &free / correlated_rows;
        for (i, sigma) in self.change_sigmas(hypothesis).iter().enumerate() {
            information[(GAIN + i, GAIN + i)] += square(*sigma).recip();
        }
        information
    }

    /// Prior standard deviations of the change.
    fn change_sigmas(&self, hypothesis: Hypothesis) -> Vec<f64> {
        match self.measured_offset.filter(|_| hypothesis == Hypothesis::HardIron) {
            Some((_, sigma_ut)) => vec![sigma_ut; 3],
            None => hypothesis.prior_sigmas(self.offset_ut.norm()),
        }
    }

    /// Fits the correction and the unknowns of a hypothesis.
    pub fn fitted(&self, rows: &[FitRow], hypothesis: Hypothesis) -> Self {
        let free = free_directions(hypothesis);
        let start =
            Self { offset_ut: self.measured_offset.map_or(self.offset_ut, |(offset_ut, _)| offset_ut), ..*self };
        let (mut fit, mut damping) = (*self, 1e-3);
        for _ in 0..MAX_ITERATIONS {
            let scales = fit.scales_ut(rows);
            let before = fit.negative_log_likelihood(rows, &scales) + fit.prior_penalty(&start);
            let Equations { normal, gradient } = fit.normal_equations(rows, &scales, &start);
            let (reduced, right_side) = (free.transpose() * normal * &free, free.transpose() * gradient);
            let mut damped = reduced.clone();
            for i in 0..damped.nrows() {
                damped[(i, i)] *= 1.0 + damping;
            }
            let Some(cholesky) = damped.cholesky() else { break };
            let step = &free * cholesky.solve(&right_side);
            let next = fit.moved_by(&SVector::from_fn(|i, _| -step[i]));
            let after = next.negative_log_likelihood(rows, &scales) + next.prior_penalty(&start);
            if after < before {
                fit = next;
                damping = (damping / 10.0).max(1e-9);
                if before - after < CONVERGED_DECREASE * before {
                    break;
                }
            } else {
                damping *= 10.0;
                if damping > 1e6 {
                    break;
                }
            }
        }
        fit
    }

    /// Negative log evidence of a fitted hypothesis by Laplace's method, up to a constant common to all hypotheses, of
    /// residuals of which `correlated_rows` successive ones count as one.
    pub fn negative_log_evidence(
        &self,
        rows: &[FitRow],
        hypothesis: Hypothesis,
        scales: &Scales,
        correlated_rows: f64,
    ) -> f64 {
        let half_log_determinant = self
            .information(rows, hypothesis, scales, correlated_rows)
            .cholesky()
            .map_or(f64::INFINITY, |cholesky| cholesky.l().diagonal().iter().map(|pivot| libm::log(*pivot)).sum());
        self.negative_log_likelihood(rows, scales) / correlated_rows
            + half_log_determinant
            + self.change_sigmas(hypothesis).iter().map(|sigma| libm::log(*sigma)).sum::<f64>()
            + self.measured_offset.map_or(0.0, |(offset_ut, sigma_ut)| {
                (self.offset_ut - offset_ut).norm_squared() / square(sigma_ut) / 2.0
            })
    }

    fn unknowns(&self) -> SVector<f64, UNKNOWNS> {
        SVector::from_fn(|i, _| match i {
            0..HARD_IRON => self.correction.matrix[(i / 3, i % 3)],
            HARD_IRON..MOTOR_CURRENT => self.correction.hard_iron_ut[i - HARD_IRON],
            MOTOR_CURRENT..STRENGTH => self.correction.motor_ut_per_a[i - MOTOR_CURRENT],
            STRENGTH => self.strength_ut,
            VERTICAL => self.vertical_ut,
            GAIN..OFFSET => self.gain[i - GAIN],
            _ => self.offset_ut[i - OFFSET],
        })
    }

    fn moved_by(&self, step: &SVector<f64, UNKNOWNS>) -> Self {
        let moved = self.unknowns() + step;
        let vector = |first: usize| Vector3::from_fn(|axis, _| moved[first + axis]);
        Self {
            correction: FieldCorrection {
                matrix: Matrix3::from_row_slice(&moved.as_slice()[..HARD_IRON]),
                hard_iron_ut: vector(HARD_IRON),
                motor_ut_per_a: vector(MOTOR_CURRENT),
            },
            strength_ut: moved[STRENGTH],
            vertical_ut: moved[VERTICAL],
            gain: vector(GAIN),
            offset_ut: vector(OFFSET),
            measured_offset: self.measured_offset,
        }
    }

    /// Prior standard deviations about the start, for unobservable unknowns. The strength is fixed, since `W` sets the
    /// scale.
    fn prior_sigmas(&self) -> SVector<f64, UNKNOWNS> {
        let hard_iron_ut = 10.0 * self.strength_ut.abs().max(1.0);
        SVector::from_fn(|i, _| match i {
            0..HARD_IRON => 0.3,
            MOTOR_CURRENT..STRENGTH => 1.0,
            STRENGTH => 1e-3,
            GAIN..OFFSET => 10.0,
            OFFSET.. => self.measured_offset.map_or(hard_iron_ut, |(_, sigma_ut)| sigma_ut),
            _ => hard_iron_ut,
        })
    }

    fn prior_penalty(&self, start: &Self) -> f64 {
        (self.unknowns() - start.unknowns()).component_div(&start.prior_sigmas()).norm_squared() / 2.0
    }

    fn prior_information(&self) -> SVector<f64, UNKNOWNS> {
        self.prior_sigmas().map(|sigma| square(sigma).recip())
    }

    /// Equations of the objective.
    fn normal_equations(&self, rows: &[FitRow], scales: &Scales, start: &Self) -> Equations {
        let information = start.prior_information();
        let gradient = (self.unknowns() - start.unknowns()).component_mul(&information);
        Equations { normal: SMatrix::from_diagonal(&information), gradient }.plus(&self.data_equations(rows, scales))
    }

    /// Equations of the residuals alone.
    fn data_equations(&self, rows: &[FitRow], scales: &Scales) -> Equations {
        let Equations { mut normal, mut gradient } = Equations::zeros();
        for row in rows {
            let residuals = self.residuals_ut(row);
            for (i, derivatives) in self.derivatives(row).iter().enumerate() {
                let variance = square(scales[group_of(row.is_changed, i)]);
                let weight = (T_FREEDOM + 1.0) / (T_FREEDOM * variance + square(residuals[i]));
                add_square(&mut normal, derivatives, weight);
                gradient.axpy(weight * residuals[i], derivatives, 1.0);
            }
        }
        normal.fill_upper_triangle_with_lower_triangle();
        Equations { normal, gradient }
    }

    /// Derivatives of both residuals by all unknowns.
    fn derivatives(&self, row: &FitRow) -> [SVector<f64, UNKNOWNS>; 2] {
        let from_offset_ut = row.raw_ut - self.offset_ut;
        residual_derivatives(&self.correction.matrix, self.raw_less_iron_ut(row), row.down).map(|by_fit| {
            let by_iron = by_fit.fixed_rows::<3>(HARD_IRON);
            SVector::from_fn(|i, _| match i {
                0..MOTOR_CURRENT => by_fit[i],
                MOTOR_CURRENT..STRENGTH => by_iron[i - MOTOR_CURRENT] * row.current_a,
                STRENGTH | VERTICAL => by_fit[MOTOR_CURRENT + i - STRENGTH],
                _ if !row.is_changed => 0.0,
                GAIN..OFFSET => -by_iron[i - GAIN] * from_offset_ut[i - GAIN],
                _ => by_iron[i - OFFSET] * self.gain[i - OFFSET],
            })
        })
    }
}

/// Derivatives of strength and vertical component, less the Earth's, by `W`, `b`, and the Earth's strength and vertical
/// component, at a raw field without hard iron.
pub(super) fn residual_derivatives(
    matrix: &Matrix3<f64>,
    raw_ut: Vector3<f64>,
    down: Vector3<f64>,
) -> [SVector<f64, FIT_UNKNOWNS>; 2] {
    let directions = [(matrix * raw_ut).normalize(), down];
    [0, 1].map(|residual_index| {
        let direction = directions[residual_index];
        let by_raw = matrix.transpose() * direction;
        SVector::from_fn(|i, _| match i {
            0..HARD_IRON => direction[i / 3] * raw_ut[i % 3],
            HARD_IRON..MOTOR_CURRENT => -by_raw[i - HARD_IRON],
            _ => -f64::from(u8::from(i == MOTOR_CURRENT + residual_index)),
        })
    })
}

/// Adds the square of derivatives, many of them zero, to the lower triangle.
fn add_square(normal: &mut SMatrix<f64, UNKNOWNS, UNKNOWNS>, derivatives: &SVector<f64, UNKNOWNS>, weight: f64) {
    for (column, derivative) in derivatives.iter().enumerate().filter(|(_, derivative)| **derivative != 0.0) {
        for row in column..UNKNOWNS {
            normal[(row, column)] += weight * derivative * derivatives[row];
        }
    }
}

/// Normal matrix and gradient.
struct Equations {
    normal: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    gradient: SVector<f64, UNKNOWNS>,
}

impl Equations {
    fn zeros() -> Self {
        Self { normal: SMatrix::zeros(), gradient: SVector::zeros() }
    }

    fn plus(&self, other: &Self) -> Self {
        Self { normal: self.normal + other.normal, gradient: self.gradient + other.gradient }
    }

    /// The equations of unchanged rows with a step of hard iron before some of them, whose derivatives are those of the
    /// hard iron.
    fn with_step(&self, after: &Self) -> Self {
        let Self { mut normal, mut gradient } = *self;
        let step = after.normal.fixed_view::<GAIN, 3>(0, HARD_IRON);
        normal.fixed_view_mut::<GAIN, 3>(0, OFFSET).copy_from(&step);
        normal.fixed_view_mut::<3, GAIN>(OFFSET, 0).copy_from(&step.transpose());
        let mut of_step = normal.fixed_view_mut::<3, 3>(OFFSET, OFFSET);
        of_step += after.normal.fixed_view::<3, 3>(HARD_IRON, HARD_IRON);
        gradient.fixed_rows_mut::<3>(OFFSET).copy_from(&after.gradient.fixed_rows::<3>(HARD_IRON));
        Self { normal, gradient }
    }

    /// Reduction of the objective by the solution.
    fn reduction(&self) -> Option<f64> {
        Some(self.normal.cholesky()?.solve(&self.gradient).dot(&self.gradient))
    }
}

/// Directions of the correction's unknowns and of the hypothesis's additional unknowns, one in each column.
fn free_directions(hypothesis: Hypothesis) -> DMatrix<f64> {
    let freed = hypothesis.freed_unknowns();
    DMatrix::from_fn(UNKNOWNS, GAIN + freed.len(), |row, column| {
        if column < GAIN { f64::from(u8::from(row == column)) } else { freed[column - GAIN][row] }
    })
}

#[cfg(test)]
mod tests {
    use testkit::random::Random;

    use super::*;
    use crate::replay::tests::compass_of_flown_turns;

    fn flown_rows_and_fit() -> (Vec<FitRow>, ChangeFit) {
        let (_, compass) = compass_of_flown_turns();
        let rows: Vec<FitRow> =
            compass.rows.iter().step_by(40).enumerate().map(|(i, row)| FitRow::new(row, i >= 25)).collect();
        let fit = ChangeFit::from_correction(&rows, &compass.parameter_fit.correction().unwrap());
        (rows, fit.with_change(Vector3::new(0.9, 1.1, 1.05), Vector3::new(2.0, -4.0, 3.0)))
    }

    #[test]
    fn derivatives_equal_finite_differences() {
        let (rows, fit) = flown_rows_and_fit();
        for row in rows.iter().step_by(10) {
            let [of_strength, of_vertical] = fit.derivatives(row);
            for (unknown, (strength, vertical)) in of_strength.iter().zip(of_vertical.iter()).enumerate() {
                let moved = |by: f64| fit.moved_by(&SVector::from_fn(|i, _| if i == unknown { by } else { 0.0 }));
                let [more, less] = [1e-4, -1e-4].map(|by| moved(by).residuals_ut(row));
                for (i, derivative) in [strength, vertical].into_iter().enumerate() {
                    let expected = (more[i] - less[i]) / 2e-4;
                    assert!((derivative - expected).abs() < 1e-5, "{unknown}, {i}: {derivative} {expected}");
                }
            }
        }
    }

    /// The linearised equations of a step are those of the rows with the side of the change.
    #[test]
    fn the_sums_of_a_candidate_are_the_equations_of_its_step() {
        let (rows, fit) = flown_rows_and_fit();
        let fit = fit.with_change(Vector3::repeat(1.0), Vector3::zeros());
        let mut random = Random(1);
        let scales = [0; GROUPS / 2].map(|_| 0.5 + f64::from(random.normal()).abs());
        let scales = [scales[0], scales[1], scales[0], scales[1]];
        let unchanged: Vec<FitRow> = rows.iter().map(|row| FitRow { is_changed: false, ..*row }).collect();
        let all = fit.data_equations(&unchanged, &scales);
        let with_step = all.with_step(&fit.data_equations(&unchanged[25..], &scales));
        let expected = fit.data_equations(&rows, &scales);
        let free = free_directions(Hypothesis::HardIron);
        let difference = free.transpose() * (with_step.normal - expected.normal) * &free;
        assert!(difference.amax() < 1e-6 * expected.normal.amax(), "{difference}");
        assert!((free.transpose() * (with_step.gradient - expected.gradient)).amax() < 1e-6);
    }
}
