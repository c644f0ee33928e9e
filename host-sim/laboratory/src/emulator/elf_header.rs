//! Validation of firmware images by their ELF header.

use std::fs::File;
use std::io::{ErrorKind, Read as _};
use std::path::Path;

use super::error::EmulatorError;

/// Length of the ELF header up to the machine field, bytes.
const HEADER_LENGTH: usize = 20;
/// Magic number, 32 bits, little-endian (System V ABI, "ELF Header").
const ELF_32_LITTLE: [u8; 6] = [0x7F, b'E', b'L', b'F', 1, 1];
const TYPE_EXECUTABLE: u16 = 2;
const MACHINE_ARM: u16 = 40;

/// Checks that a file is an ELF executable for ARM. QEMU would load any other file as raw memory and run it without an
/// error.
///
/// # Errors
///
/// The file is missing or has another type.
pub fn check_image(path: &Path) -> Result<(), EmulatorError> {
    let no_image = |_| EmulatorError::NoImage(path.to_owned());
    let not_firmware = |reason| Err(EmulatorError::NotFirmware(path.to_owned(), reason));
    if !path.is_file() {
        return Err(EmulatorError::NoImage(path.to_owned()));
    }
    let mut header = [0; HEADER_LENGTH];
    match File::open(path).map_err(no_image)?.read_exact(&mut header) {
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => return not_firmware("it is too short"),
        read => read.map_err(no_image)?,
    }
    let [magic @ .., kind_0, kind_1, machine_0, machine_1] = header;
    if !magic.starts_with(&ELF_32_LITTLE[..4]) {
        return not_firmware("it is no ELF file");
    }
    let is_arm = magic.starts_with(&ELF_32_LITTLE) && u16::from_le_bytes([machine_0, machine_1]) == MACHINE_ARM;
    match u16::from_le_bytes([kind_0, kind_1]) {
        TYPE_EXECUTABLE if is_arm => Ok(()),
        _ if is_arm => not_firmware("it is no executable"),
        _ => not_firmware("it is for another processor than ARM"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Header of an ARM executable with some bytes changed.
    fn header(changed: &[(usize, u8)]) -> Vec<u8> {
        let mut bytes = [&ELF_32_LITTLE[..], &[1, 0, 0, 0, 0, 0, 0, 0, 0, 0], &[2, 0, 40, 0]].concat();
        for &(at, byte) in changed {
            bytes[at] = byte;
        }
        bytes
    }

    #[test]
    fn only_an_arm_executable_is_accepted() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("image");
        let checked = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            check_image(&path).map_err(|error| error.to_string())
        };
        assert_eq!(checked(&header(&[])), Ok(()));
        for (bytes, reason) in [
            (vec![], "it is too short"),
            (header(&[])[..HEADER_LENGTH - 1].to_vec(), "it is too short"),
            (header(&[(0, b'#')]), "it is no ELF file"),
            (header(&[(3, b'f')]), "it is no ELF file"),
            // Rejected ELF files: of 64 bits, big-endian, for x86-64, and a library.
            (header(&[(4, 2)]), "it is for another processor than ARM"),
            (header(&[(5, 2)]), "it is for another processor than ARM"),
            (header(&[(18, 62)]), "it is for another processor than ARM"),
            (header(&[(16, 3)]), "it is no executable"),
        ] {
            let error = checked(&bytes).unwrap_err();
            assert!(error.contains(&format!("is no firmware: {reason}; scripts/build-firmware")), "{bytes:?}: {error}");
            assert!(error.starts_with(path.to_str().unwrap()), "{error}");
        }
        assert_eq!(check_image(folder.path()).unwrap_err().stable_code(), "no-image");
        assert_eq!(check_image(&folder.path().join("none")).unwrap_err().stable_code(), "no-image");
    }
}
