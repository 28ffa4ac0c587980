/* What a codec that a file has taken over might do; nothing but in the program for tests (tests/unit/test_isolate.c).
 */
#ifndef HADA_READER_MISBEHAVE_H
#define HADA_READER_MISBEHAVE_H

#ifdef HADALENS_MISBEHAVE
void hada_misbehave(int file);
#else
static inline void hada_misbehave(int file)
{
    (void)file;
}
#endif

#endif
