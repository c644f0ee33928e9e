//! Information matrix of many Jacobian rows, packed.

use nalgebra::Vector3;

use crate::calibration::model::{
    INCLINATION_INDEX, JacobianRow, UNKNOWN_COUNT, UPPER_TRIANGLE_3, UPPER_TRIANGLE_4, Vector13,
    unknown_index_of_product,
};

/// Sum of `weight row row^T`. A row is `k (x, 1)^T` except for its last element, so the sum has only 73 different
/// elements: 60 products of two components of `k` and two of `(x, 1)`, and 13 with the last element. 292 bytes.
#[derive(Clone, Debug)]
pub(crate) struct InformationMatrix {
    /// Products by pairs of components of `k`, then by pairs of components of `(x, 1)`.
    field_derivative_products: [[f32; 10]; 6],
    /// Products of the components of `k` and `(x, 1)` with the last element, the derivative by the inclination.
    inclination_derivative_products: [[f32; 4]; 3],
    inclination_derivative_squares: f32,
}

impl InformationMatrix {
    pub const fn zero() -> Self {
        Self {
            field_derivative_products: [[0.0; 10]; 6],
            inclination_derivative_products: [[0.0; 4]; 3],
            inclination_derivative_squares: 0.0,
        }
    }

    #[inline]
    pub fn add_row(&mut self, row: &JacobianRow, weight: f32) {
        self.add_inclination_derivative_products(row, weight);
        self.add_field_derivative_products(&row.centred_field, weighted_field_derivative_products(row, weight));
    }

    /// Adds the outer products of two rows of one measurement, hardly slower than one.
    #[inline]
    pub fn add_row_pair(&mut self, rows: [&JacobianRow; 2], weights: [f32; 2]) {
        let [first, second] = [(rows[0], weights[0]), (rows[1], weights[1])].map(|(row, weight)| {
            self.add_inclination_derivative_products(row, weight);
            weighted_field_derivative_products(row, weight)
        });
        let [a, b, c, d, e, f] = second;
        let [x, y, z, u, v, w] = first;
        self.add_field_derivative_products(&rows[0].centred_field, [a + x, b + y, c + z, d + u, e + v, f + w]);
    }

    /// Adds weighted products of `k` times those of `(x, 1)`. Unrolled: runs for each sample and pass.
    #[inline]
    fn add_field_derivative_products(&mut self, x: &Vector3<f32>, pair_products: [f32; 6]) {
        let [x, y, z] = [x.x, x.y, x.z];
        let [xx, xy, xz, yy, yz, zz] = [x * x, x * y, x * z, y * y, y * z, z * z];
        for (sums, k) in self.field_derivative_products.iter_mut().zip(&pair_products) {
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

    #[inline]
    fn add_inclination_derivative_products(&mut self, row: &JacobianRow, weight: f32) {
        let derivative_by_inclination = row.derivative_by_inclination;
        if derivative_by_inclination == 0.0 {
            return;
        }
        let weight = weight * derivative_by_inclination;
        for (sums, k) in self.inclination_derivative_products.iter_mut().zip([
            row.derivative_by_field.x,
            row.derivative_by_field.y,
            row.derivative_by_field.z,
        ]) {
            let k = k * weight;
            sums[0] += k * row.centred_field.x;
            sums[1] += k * row.centred_field.y;
            sums[2] += k * row.centred_field.z;
            sums[3] += k;
        }
        self.inclination_derivative_squares += weight * derivative_by_inclination;
    }

    pub fn multiply_vector(&self, vector: &Vector13) -> Vector13 {
        let mut product = Vector13::zeros();
        self.for_each_element(|i, j, element| {
            product[i] += element * vector[j];
            if i != j {
                product[j] += element * vector[i];
            }
        });
        product
    }

    /// Calls `visit` with the indices and value of each element of one triangle.
    pub fn for_each_element(&self, mut visit: impl FnMut(usize, usize, f32)) {
        for (&(k, l), products_of_pair) in UPPER_TRIANGLE_3.iter().zip(&self.field_derivative_products) {
            for (&(a, b), &element) in UPPER_TRIANGLE_4.iter().zip(products_of_pair) {
                visit(unknown_index_of_product(k, a), unknown_index_of_product(l, b), element);
                if k != l && a != b {
                    visit(unknown_index_of_product(k, b), unknown_index_of_product(l, a), element);
                }
            }
        }
        for (k, products_of_pair) in self.inclination_derivative_products.iter().enumerate() {
            for (a, &element) in products_of_pair.iter().enumerate() {
                visit(unknown_index_of_product(k, a), INCLINATION_INDEX, element);
            }
        }
        visit(INCLINATION_INDEX, INCLINATION_INDEX, self.inclination_derivative_squares);
    }

    pub fn upper_triangle(&self) -> [[f32; UNKNOWN_COUNT]; UNKNOWN_COUNT] {
        let mut triangle = [[0.0; UNKNOWN_COUNT]; UNKNOWN_COUNT];
        self.for_each_element(|i, j, element| {
            if let Some(slot) = triangle.get_mut(i.min(j)).and_then(|row| row.get_mut(i.max(j))) {
                *slot = element;
            }
        });
        triangle
    }
}

/// Weighted products of two components of `k`, in the order of `UPPER_TRIANGLE_3`.
fn weighted_field_derivative_products(row: &JacobianRow, weight: f32) -> [f32; 6] {
    let [a, b, c] = [row.derivative_by_field.x, row.derivative_by_field.y, row.derivative_by_field.z];
    let [wa, wb, wc] = [weight * a, weight * b, weight * c];
    [wa * a, wa * b, wa * c, wb * b, wb * c, wc * c]
}

#[cfg(test)]
mod tests {

    use super::*;
    use crate::calibration::model::Matrix13;
    use crate::calibration::tests::synthetic::{Random, random_vector};

    fn random_jacobian_rows(random: &mut Random) -> [JacobianRow; 2] {
        let x = random_vector(random, 1.0);
        [0.0, -1.0].map(|derivative_by_inclination| JacobianRow {
            derivative_by_field: random_vector(random, 1.0),
            centred_field: x,
            derivative_by_inclination,
        })
    }

    #[test]
    fn packed_matrix_equals_the_full_matrix() {
        let mut random = Random(9);
        let (mut squares, mut full) = (InformationMatrix::zero(), Matrix13::zeros());
        for i in 0..20 {
            let rows = random_jacobian_rows(&mut random);
            if i % 2 == 0 {
                squares.add_row_pair(rows.each_ref(), [2.0, 3.0]);
            } else {
                squares.add_row(&rows[0], 2.0);
                squares.add_row(&rows[1], 3.0);
            }
            for (row, weight) in rows.iter().zip([2.0, 3.0]) {
                full += row.as_vector() * row.as_vector().transpose() * weight;
            }
        }
        let vector = Vector13::from_fn(|_, _| random.uniform(-1.0, 1.0));
        assert!((squares.multiply_vector(&vector) - full * vector).norm() < 1e-5 * full.norm());
        let triangle = squares.upper_triangle();
        for i in 0..UNKNOWN_COUNT {
            for j in i..UNKNOWN_COUNT {
                assert!((triangle[i][j] - full[(i, j)]).abs() < 1e-5 * full.norm(), "{i} {j}");
            }
        }
    }
}
