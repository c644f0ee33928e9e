//! Text and numbers of the page.

/// Text as a page or a picture shows it, within quotes too.
pub fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            '\n' | '\t' => escaped.push(c),
            // Control characters are no part of a page, and some are an error in it.
            c if c.is_control() || ('\u{202a}'..='\u{202e}').contains(&c) || ('\u{2066}'..='\u{2069}').contains(&c) => {
            }
            c => escaped.push(c),
        }
    }
    escaped
}

/// A number with so many decimals; a dash for what is none.
pub fn number(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    let text = format!("{value:.decimals$}");
    // Nothing is not negative.
    if text.bytes().all(|byte| matches!(byte, b'-' | b'0' | b'.')) { text.replace('-', "") } else { text }
}

/// As [`number`], with a dash for nothing.
pub fn number_or_dash(value: Option<f64>, decimals: usize) -> String {
    number(value.unwrap_or(f64::NAN), decimals)
}

/// What is made of each, one after the other.
pub fn each<T>(of: impl IntoIterator<Item = T>, make: impl FnMut(T) -> String) -> String {
    of.into_iter().map(make).collect::<Vec<_>>().concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_words_are_safe() {
        assert_eq!(number(-0.001, 2), "0.00");
        assert_eq!(number(-0.006, 2), "-0.01");
        assert_eq!(number(f64::NAN, 2), "–");
        assert_eq!(number_or_dash(None, 1), "–");
        assert_eq!(escaped("a\u{0}\u{1b}[2K\u{202e}<'\"&>"), "a[2K&lt;&#39;&quot;&amp;&gt;");
    }
}
