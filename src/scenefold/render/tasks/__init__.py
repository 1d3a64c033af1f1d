"""Images by visual and by temporal partition: whoever renders holds the whole scene, and pixels or frames are shared out (specs/32-partitions.md)."""
