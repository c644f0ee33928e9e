//! NMEA parser, independent of the library's writer.

/// Values of a received heading sentence.
#[derive(Clone, Debug, PartialEq)]
pub struct HeadingSentence {
    /// Talker and sentence type: `HCHDM`, `HCHDG`, `HCHDT` or `PASWH`.
    pub sentence_kind: String,
    /// Heading in degrees, true in `HCHDT`, otherwise magnetic; `None` if the field is empty.
    pub heading_deg: Option<f64>,
    /// Standard deviation, degrees; only in `PASWH` with a heading.
    pub sigma_deg: Option<f64>,
    /// `ok`, or the reason of a missing heading; only in `PASWH`.
    pub status: Option<String>,
    /// `smooth` or `raw`; only in `PASWH` with a heading.
    pub heading_kind: Option<String>,
}

/// Sentence parser for a byte stream.
#[derive(Clone, Debug, Default)]
pub struct SentenceReader {
    line: Vec<u8>,
    /// Number of invalid lines.
    pub invalid_lines: u32,
}

impl SentenceReader {
    /// Processes a byte and returns a completed valid sentence.
    pub fn push_byte(&mut self, byte: u8) -> Option<HeadingSentence> {
        if byte != b'\n' {
            self.line.push(byte);
            return None;
        }
        let line = std::mem::take(&mut self.line);
        let received = parse_sentence(&line);
        self.invalid_lines += u32::from(received.is_none());
        received
    }
}

fn parse_sentence(line: &[u8]) -> Option<HeadingSentence> {
    let line = std::str::from_utf8(line).ok()?.strip_suffix('\r')?;
    let (body, checksum) = line.strip_prefix('$')?.rsplit_once('*')?;
    let xor_sum = body.bytes().fold(0, |xor_sum, byte| xor_sum ^ byte);
    if u8::from_str_radix(checksum, 16) != Ok(xor_sum) {
        return None;
    }
    let mut fields = body.split(',');
    let sentence_kind = fields.next()?.to_owned();
    let heading = fields.next()?;
    let heading_deg = if heading.is_empty() { None } else { Some(heading.parse().ok()?) };
    let (sigma_deg, status, heading_kind_field) = if sentence_kind == "PASWH" {
        let sigma = fields.next()?;
        let sigma_deg = if heading_deg.is_some() { Some(sigma.parse().ok()?) } else { None };
        let (status, heading_kind_field) = (fields.next()?.to_owned(), fields.next()?);
        (sigma_deg, Some(status), (!heading_kind_field.is_empty()).then(|| heading_kind_field.to_owned()))
    } else {
        (None, None, None)
    };
    Some(HeadingSentence { sentence_kind, heading_deg, sigma_deg, status, heading_kind: heading_kind_field })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_sentences(text: &str) -> (Vec<HeadingSentence>, u32) {
        let mut reader = SentenceReader::default();
        let received = text.bytes().filter_map(|byte| reader.push_byte(byte)).collect();
        (received, reader.invalid_lines)
    }

    #[test]
    fn valid_sentences_are_read_and_others_counted() {
        let (received, invalid) = read_sentences("$HCHDM,101.1,M*28\r\n$HCHDM,,M*07\r\n$HCHDM,101.2,M*28\r\nnoise\r\n");
        let headings: Vec<_> = received.iter().map(|sentence| sentence.heading_deg).collect();
        assert_eq!(headings, [Some(101.1), None]);
        assert_eq!(invalid, 2);
    }
}
