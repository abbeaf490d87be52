//! Pairs of marks on a page, `<!-- KIND KEY=VALUE ... -->` and `<!-- /KIND -->`, and what stands between them.

use anyhow::{Context as _, bail, ensure};

/// An opening mark.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Mark<'a> {
    /// Its first word.
    pub(super) kind: &'a str,
    options: Vec<(&'a str, &'a str)>,
}

impl<'a> Mark<'a> {
    fn parse(inner: &'a str) -> anyhow::Result<Self> {
        let mut words = inner.split_whitespace();
        let kind = words.next().unwrap_or_default();
        let options = words
            .map(|pair| pair.split_once('=').with_context(|| format!("`{pair}` is not key=value")));
        Ok(Self { kind, options: options.collect::<anyhow::Result<_>>()? })
    }

    /// The value of a key.
    pub(super) fn get(&self, key: &str) -> Option<&'a str> {
        self.options.iter().find(|(k, _)| *k == key).map(|(_, value)| *value)
    }

    /// The values of a key, between commas.
    pub(super) fn list(&self, key: &str) -> Option<Vec<&'a str>> {
        self.get(key).map(|value| value.split(',').collect())
    }

    /// Fails where the mark has a key that is not one of `keys`.
    pub(super) fn knows(&self, keys: &[&str]) -> anyhow::Result<()> {
        for (key, _) in &self.options {
            ensure!(keys.contains(key), "unknown key `{key}`; there are {}", keys.join(", "));
        }
        Ok(())
    }
}

/// Words that open a mark of ours; other comments are left alone.
const KINDS: [&str; 3] = ["measured", "scaled", "pictured"];

/// The text with what `fill` gives between the marks of each pair, and the number of pairs.
pub(super) fn replaced(
    text: &str,
    mut fill: impl FnMut(&Mark<'_>) -> anyhow::Result<String>,
) -> anyhow::Result<(String, usize)> {
    let (mut out, mut rest, mut count) = (String::new(), text, 0);
    // A mark stands at the beginning of a line; elsewhere it is only spoken of.
    let opens = |line: &str| {
        let inner = line.strip_prefix("<!-- ")?;
        KINDS.iter().any(|kind| inner.split(' ').next() == Some(kind)).then_some(())
    };
    while !rest.is_empty() {
        let end = rest.find('\n').map_or(rest.len(), |n| n + 1);
        let line = &rest[..end];
        out += line;
        rest = &rest[end..];
        if opens(line).is_none() {
            continue;
        }
        let shown = line.trim();
        let inner = shown.trim_start_matches("<!-- ").trim_end_matches("-->");
        let mark = Mark::parse(inner).with_context(|| format!("`{shown}`"))?;
        let close = format!("<!-- /{} -->", mark.kind);
        let Some(closed) = rest.find(&close) else { bail!("`{shown}` has no `{close}`") };
        out += &fill(&mark).with_context(|| format!("`{shown}`"))?;
        rest = &rest[closed..];
        count += 1;
    }
    Ok((out, count))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAGE: &str =
        "a\n<!-- measured x=1,2 y=3 -->\nold\n<!-- /measured -->\nb <!-- measured -->\n";

    #[test]
    fn what_stands_between_marks_is_replaced() {
        let (text, count) = replaced(PAGE, |mark| {
            assert_eq!((mark.kind, mark.get("y"), mark.get("z")), ("measured", Some("3"), None));
            assert_eq!(mark.list("x"), Some(vec!["1", "2"]));
            assert!(mark.knows(&["x", "y"]).is_ok() && mark.knows(&["x"]).is_err());
            Ok("new\n".to_owned())
        })
        .expect("a sound page");
        assert_eq!((text, count), (PAGE.replace("old", "new"), 1));
    }

    #[test]
    fn marks_without_an_end_or_a_value_are_errors() {
        for page in ["<!-- measured x=1 -->\n", "<!-- measured x -->\n<!-- /measured -->\n"] {
            assert!(replaced(page, |_| Ok(String::new())).is_err(), "{page}");
        }
    }
}
