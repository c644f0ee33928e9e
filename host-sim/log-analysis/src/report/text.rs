/// Escapes text for HTML, including quotes.
pub fn escape_html(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            '\n' | '\t' => escaped.push(character),
            // Control and bidirectional characters are dropped; some are invalid in HTML.
            character
                if character.is_control()
                    || ('\u{202a}'..='\u{202e}').contains(&character)
                    || ('\u{2066}'..='\u{2069}').contains(&character) => {}
            character => escaped.push(character),
        }
    }
    escaped
}

pub fn concat_map<T>(items: impl IntoIterator<Item = T>, make: impl FnMut(T) -> String) -> String {
    items.into_iter().map(make).collect::<Vec<_>>().concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn html_and_control_characters_are_escaped_or_dropped() {
        assert_eq!(escape_html("a\u{0}\u{1b}[2K\u{202e}<'\"&>"), "a[2K&lt;&#39;&quot;&amp;&gt;");
    }
}
