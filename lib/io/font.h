/* A small bitmap font for pictures: printable ASCII. Internal. */
#ifndef HADA_IO_FONT_H
#define HADA_IO_FONT_H

enum { HADA_FONT_WIDTH = 5, HADA_FONT_HEIGHT = 7, HADA_FONT_ADVANCE = 6 };

/* Seven rows of five bits (bit 4 is the left column); '?' for what is not ASCII. */
const unsigned char *hada_font_glyph(unsigned character);

#endif
