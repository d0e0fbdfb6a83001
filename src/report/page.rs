//! The page: its files in one.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::packing::pack;
use super::story::Story;

/// The frame into which everything else is put.
const FRAME: &str = include_str!("page/index.html");
const STYLES: [&str; 2] =
    [include_str!("page/vendor/uPlot.min.css"), include_str!("page/page.css")];
/// In the order in which they use each other.
const SCRIPTS: [&str; 12] = [
    include_str!("page/vendor/uPlot.iife.min.js"),
    include_str!("page/elements.js"),
    include_str!("page/story.js"),
    include_str!("page/theme.js"),
    include_str!("page/later.js"),
    include_str!("page/clock.js"),
    include_str!("page/plots.js"),
    include_str!("page/road.js"),
    include_str!("page/latency.js"),
    include_str!("page/misses.js"),
    include_str!("page/tables.js"),
    include_str!("page/main.js"),
];
const LICENCE: &str = include_str!("page/vendor/LICENSE");

/// The page of one or two stories.
///
/// # Errors
/// When they cannot be packed.
pub fn html(stories: &[Story]) -> std::io::Result<String> {
    let data = STANDARD.encode(pack(stories)?);
    Ok(FRAME
        .replacen("/* styles */", &STYLES.join("\n"), 1)
        .replacen("/* scripts */", &SCRIPTS.join("\n"), 1)
        .replacen("<!-- licence -->", LICENCE, 1)
        .replacen("<!-- data -->", &data, 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_asks_for_nothing_from_outside() {
        let page = html(&[Story::default()]).expect("packs");
        for reference in ["src=\"", "href=\"http", "@import", "url(", "fetch(", "XMLHttpRequest"] {
            assert!(!page.contains(reference), "{reference}");
        }
        assert!(!page.contains("<!-- data -->") && !page.contains("/* scripts */"));
    }
}
