/* Numbers of the library's own transforms. Internal to lib/fft. */
#ifndef HADA_FFT_OWN_H
#define HADA_FFT_OWN_H

#define HADA_OWN_BLOCK 8 /* columns of a spectrum's block */

#endif
