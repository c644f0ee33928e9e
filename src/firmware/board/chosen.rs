//! The board that a Cargo feature selects.

#[cfg(feature = "board-b-l475e-iot01a")]
pub use crate::board::b_l475e_iot01a::*;
#[cfg(all(feature = "board-holybro-rm3100", not(feature = "board-b-l475e-iot01a")))]
pub use crate::board::holybro_rm3100::*;
#[cfg(all(
    feature = "board-mps2-an386",
    not(any(feature = "board-b-l475e-iot01a", feature = "board-holybro-rm3100"))
))]
pub use crate::board::mps2_an386::*;
