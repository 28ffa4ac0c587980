/* Colours for distances. Internal. */
#ifndef HADA_IO_COLORMAP_H
#define HADA_IO_COLORMAP_H

/* The colour at 0 (dark violet) to 1 (light yellow-green) as sRGB bytes.
 *
 * A helix in Oklab (B. Ottosson, "A perceptual color space for image processing", 2020): lightness rises evenly from
 * 0.25 to 0.92 while the hue turns evenly from 340 to 115 degrees at the chroma 0.11. Lightness, hue and chroma all
 * change at constant speed, so equal steps in distance are equal steps in colour, also for the colour-blind and in
 * grey. The end points are those of the longest such helix inside sRGB on a grid of 5 degrees and 0.02 of chroma. */
void hada_colormap(double at, unsigned char rgb[3]);

#endif
