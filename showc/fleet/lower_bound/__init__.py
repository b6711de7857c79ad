"""Times that no flight of a leg can beat, each with its proof."""
