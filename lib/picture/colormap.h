/* Colours for distances. Internal. */
#ifndef HADA_PICTURE_COLORMAP_H
#define HADA_PICTURE_COLORMAP_H

#include <stdint.h>

/* The colour at 0 (dark purple) to 1 (light yellow) as 0xRRGGBB.
 *
 * A helix in Oklab (B. Ottosson, "A perceptual color space for image processing", 2020): lightness rises evenly from
 * 0.32 (visible on a dark sheet) to 0.93 while the hue turns evenly from 360 to 100 degrees at the chroma 0.115. All
 * change at constant speed, so equal steps in distance are equal steps in colour, and also in grey. It is the longest
 * such helix inside sRGB on a grid of 5 degrees and 0.005 of chroma. */
uint32_t hada_colormap(double at);

#endif
