//! Sums of squares of rows, as few numbers as they have.

use nalgebra::Vector3;

use super::unknowns::{INCLINATION, PAIRS_OF_3, PAIRS_OF_4, Row, UNKNOWNS, Vector13, of_product};

/// A sum of `weight row row^T`. A row is `k (x, 1)^T` but for its last element, so its square is all products of two of
/// `k` and two of `(x, 1)`: sixty numbers, and thirteen of the last element's. 292 bytes.
#[derive(Clone, Debug)]
pub(crate) struct Squares {
    /// By pairs of `k`'s components, then by pairs of `(x, 1)`'s.
    products: [[f32; 10]; 6],
    /// Of `k`'s and `(x, 1)`'s components with the last element.
    with_inclination: [[f32; 4]; 3],
    of_inclination: f32,
}

impl Squares {
    /// Of no rows.
    pub const fn none() -> Self {
        Self { products: [[0.0; 10]; 6], with_inclination: [[0.0; 4]; 3], of_inclination: 0.0 }
    }

    /// Adds the square of a row with its weight.
    pub fn add(&mut self, row: &Row, weight: f32) {
        self.add_last(row, weight);
        self.add_products(&row.x, of_field(row, weight));
    }

    /// Adds the squares of two rows of one measurement with their weights, in hardly more time than one.
    pub fn add_two(&mut self, rows: [&Row; 2], weights: [f32; 2]) {
        let [one, other] = [(rows[0], weights[0]), (rows[1], weights[1])].map(|(row, weight)| {
            self.add_last(row, weight);
            of_field(row, weight)
        });
        let [a, b, c, d, e, f] = other;
        let [x, y, z, u, v, w] = one;
        self.add_products(&rows[0].x, [a + x, b + y, c + z, d + u, e + v, f + w]);
    }

    /// Adds products of `k`'s components by those of a measurement. Straight, for it is done for each sample and pass.
    #[inline(never)]
    fn add_products(&mut self, x: &Vector3<f32>, of_field: [f32; 6]) {
        let [x, y, z] = [x.x, x.y, x.z];
        let [xx, xy, xz, yy, yz, zz] = [x * x, x * y, x * z, y * y, y * z, z * z];
        for (sums, k) in self.products.iter_mut().zip(of_field) {
            sums[0] += k * xx;
            sums[1] += k * xy;
            sums[2] += k * xz;
            sums[3] += k * x;
            sums[4] += k * yy;
            sums[5] += k * yz;
            sums[6] += k * y;
            sums[7] += k * zz;
            sums[8] += k * z;
            sums[9] += k;
        }
    }

    /// Adds what the last element of a row makes.
    fn add_last(&mut self, row: &Row, weight: f32) {
        let last = row.by_inclination;
        if last == 0.0 {
            return;
        }
        let weight = weight * last;
        for (sums, k) in self.with_inclination.iter_mut().zip([row.by_field.x, row.by_field.y, row.by_field.z]) {
            let k = k * weight;
            sums[0] += k * row.x.x;
            sums[1] += k * row.x.y;
            sums[2] += k * row.x.z;
            sums[3] += k;
        }
        self.of_inclination += weight * last;
    }

    /// The sum times a vector.
    pub fn times(&self, vector: &Vector13) -> Vector13 {
        let mut product = Vector13::zeros();
        self.for_each(|i, j, element| {
            product[i] += element * vector[j];
            if i != j {
                product[j] += element * vector[i];
            }
        });
        product
    }

    /// Each element on and to one side of the diagonal, once, with its indices.
    pub fn for_each(&self, mut each: impl FnMut(usize, usize, f32)) {
        for (&(k, l), of_x) in PAIRS_OF_3.iter().zip(&self.products) {
            for (&(a, b), &element) in PAIRS_OF_4.iter().zip(of_x) {
                each(of_product(k, a), of_product(l, b), element);
                if k != l && a != b {
                    each(of_product(k, b), of_product(l, a), element);
                }
            }
        }
        for (k, of_x) in self.with_inclination.iter().enumerate() {
            for (a, &element) in of_x.iter().enumerate() {
                each(of_product(k, a), INCLINATION, element);
            }
        }
        each(INCLINATION, INCLINATION, self.of_inclination);
    }

    /// All elements: the upper triangle, whose rows begin on the diagonal.
    pub fn triangle(&self) -> [[f32; UNKNOWNS]; UNKNOWNS] {
        let mut triangle = [[0.0; UNKNOWNS]; UNKNOWNS];
        self.for_each(|i, j, element| {
            if let Some(slot) = triangle.get_mut(i.min(j)).and_then(|row| row.get_mut(i.max(j))) {
                *slot = element;
            }
        });
        triangle
    }
}

/// Products of two of `k`'s components, with a weight, in the order of `PAIRS_OF_3`.
fn of_field(row: &Row, weight: f32) -> [f32; 6] {
    let [a, b, c] = [row.by_field.x, row.by_field.y, row.by_field.z];
    let [wa, wb, wc] = [weight * a, weight * b, weight * c];
    [wa * a, wa * b, wa * c, wb * b, wb * c, wc * c]
}

#[cfg(test)]
mod tests {

    use super::super::unknowns::Matrix13;
    use super::*;
    use crate::calibration::tests::synthetic::{Random, vector};

    fn rows(random: &mut Random) -> [Row; 2] {
        let x = vector(random, 1.0);
        [0.0, -1.0].map(|by_inclination| Row { by_field: vector(random, 1.0), x, by_inclination })
    }

    /// Against full matrices: the sum, its product with a vector, and its upper triangle.
    #[test]
    fn a_sum_of_squares_is_that_of_the_rows() {
        let mut random = Random(9);
        let (mut squares, mut full) = (Squares::none(), Matrix13::zeros());
        for i in 0..20 {
            let rows = rows(&mut random);
            if i % 2 == 0 {
                squares.add_two(rows.each_ref(), [2.0, 3.0]);
            } else {
                squares.add(&rows[0], 2.0);
                squares.add(&rows[1], 3.0);
            }
            for (row, weight) in rows.iter().zip([2.0, 3.0]) {
                full += row.dense() * row.dense().transpose() * weight;
            }
        }
        let vector = Vector13::from_fn(|_, _| random.uniform(-1.0, 1.0));
        assert!((squares.times(&vector) - full * vector).norm() < 1e-5 * full.norm());
        let triangle = squares.triangle();
        for i in 0..UNKNOWNS {
            for j in i..UNKNOWNS {
                assert!((triangle[i][j] - full[(i, j)]).abs() < 1e-5 * full.norm(), "{i} {j}");
            }
        }
    }
}
