//! From a photo and a map pack to a fix: matching, homography, gates, the Localizer.
