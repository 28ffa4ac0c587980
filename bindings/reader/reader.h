/* Takes the rights away that decoding a file does not need. */
#ifndef HADA_READER_H
#define HADA_READER_H

/* From here on this process opens no files but, where `reopens`, the one that is open as number `file`; it makes no
 * connections, starts no processes and threads, runs no code that was not loaded before, and can signal nobody else. 0
 * on success; else this kernel cannot do it. */
int hada_seal(int file, int reopens);

#endif
