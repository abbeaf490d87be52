//! Soft shadows of area lights from what the light sees: percentage-closer soft shadows, back projection and their kin.
