//! Files of a .zip archive, read as a stream in their order. Sizes in the headers are needed only for content that is not
//! compressed by deflate, because deflate marks its own end. (The crate `zip` reads no stream whose sizes follow the content.)

use std::io::{self, BufRead, BufReader, ErrorKind, Read};

use flate2::bufread::DeflateDecoder;

const LOCAL_HEADER: [u8; 4] = *b"PK\x03\x04";
const END_OF_EMPTY_ARCHIVE: [u8; 4] = *b"PK\x05\x06";

/// Largest number of entries; no archive of a flight has more.
const MAX_ENTRIES: usize = 1000;

/// Most bytes between the content and the next header: a descriptor with sizes of 64 bits.
const MAX_DESCRIPTOR_BYTES: usize = 24;

const IS_ENCRYPTED: u16 = 1;
const SIZES_FOLLOW: u16 = 1 << 3;
const METHOD_STORED: u16 = 0;
const METHOD_DEFLATE: u16 = 8;

/// Receives the name and the content of a file.
pub type EntryVisitor<'a> = dyn FnMut(String, &mut dyn Read) -> io::Result<()> + 'a;

/// Whether these are the first bytes of an archive.
pub fn matches_header(first_bytes: &[u8]) -> bool {
    first_bytes.starts_with(&LOCAL_HEADER) || first_bytes.starts_with(&END_OF_EMPTY_ARCHIVE)
}

/// Passes each file of an archive to `visit`; folders are skipped.
pub fn visit_entries(source: &mut dyn Read, visit: &mut EntryVisitor<'_>) -> io::Result<()> {
    let mut source = BufReader::new(source);
    for _ in 0..MAX_ENTRIES {
        if !skip_to_header(&mut source)? {
            return Ok(());
        }
        visit_entry(&mut source, visit)?;
    }
    Err(invalid("the archive has too many files"))
}

/// Reads up to the end of the next local header's signature; false at the archive's directory or end.
fn skip_to_header(source: &mut impl BufRead) -> io::Result<bool> {
    let mut last_bytes = [0; LOCAL_HEADER.len()];
    for byte in source.by_ref().bytes().take(MAX_DESCRIPTOR_BYTES + LOCAL_HEADER.len()) {
        last_bytes.rotate_left(1);
        last_bytes[LOCAL_HEADER.len() - 1] = byte?;
        if last_bytes == LOCAL_HEADER {
            return Ok(true);
        }
    }
    Ok(false)
}

fn visit_entry(source: &mut BufReader<&mut dyn Read>, visit: &mut EntryVisitor<'_>) -> io::Result<()> {
    let mut header = [0; 26];
    source.read_exact(&mut header)?;
    let number = |at: usize| u16::from_le_bytes([header[at], header[at + 1]]);
    let (flags, method) = (number(2), number(4));
    let size = u64::from(number(14)) | u64::from(number(16)) << 16;
    let mut name = vec![0; usize::from(number(22))];
    source.read_exact(&mut name)?;
    io::copy(&mut source.by_ref().take(u64::from(number(24))), &mut io::sink())?;
    let name = String::from_utf8_lossy(&name).into_owned();
    if flags & IS_ENCRYPTED != 0 {
        return Err(invalid("the archive is encrypted"));
    }
    match method {
        METHOD_DEFLATE => visit_content(name, &mut DeflateDecoder::new(source), visit),
        METHOD_STORED if flags & SIZES_FOLLOW == 0 => visit_content(name, &mut source.by_ref().take(size), visit),
        _ => Err(invalid("the archive is compressed by a method that is not read: use deflate")),
    }
}

/// Reads the content to its end, whether `visit` does or not.
fn visit_content(name: String, content: &mut dyn Read, visit: &mut EntryVisitor<'_>) -> io::Result<()> {
    let mut content = BoundedContent::new(content);
    if !name.ends_with('/') {
        visit(name, &mut content)?;
    }
    io::copy(&mut content, &mut io::sink()).map(drop)
}

/// A compressed content that is an error if it is larger than any log.
pub struct BoundedContent<R> {
    content: R,
    remaining_bytes: u64,
}

impl<R> BoundedContent<R> {
    /// 16 GB; the longest flights have one.
    const MAX_BYTES: u64 = 1 << 34;

    pub const fn new(content: R) -> Self {
        Self { content, remaining_bytes: Self::MAX_BYTES }
    }
}

impl<R: Read> Read for BoundedContent<R> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let count = self.content.read(into)?;
        self.remaining_bytes =
            self.remaining_bytes.checked_sub(count as u64).ok_or(invalid("the archive unpacks to over 16 GB"))?;
        Ok(count)
    }
}

fn invalid(reason: &'static str) -> io::Error {
    io::Error::new(ErrorKind::InvalidData, reason)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_content_larger_than_any_log_is_an_error() {
        let mut content = BoundedContent { content: io::repeat(0), remaining_bytes: 10 };
        assert_eq!([7, 3].map(|count| content.read(&mut [0; 7][..count]).unwrap()), [7, 3]);
        assert!(content.read(&mut [0]).is_err());
    }
}
