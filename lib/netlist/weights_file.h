/* Nets in safetensors files, by themselves or as a part of a larger file. Internal. */
#ifndef HADA_NETLIST_WEIGHTS_FILE_H
#define HADA_NETLIST_WEIGHTS_FILE_H

#include "io/safetensors.h"
#include "netlist/net_list.h"

/* The key of a net's description in the metadata of a file of its own. */
#define HADA_NET_META "net"

/* Fills the net's values from the tensors `prefix` + name; every parameter must be there, in the right shape and any
 * float type. Tensors that the net does not name are ignored. The values are unchanged on failure. */
hada_status hada_net_read(hada_net *net, const hada_tensors *file, const char *prefix, hada_error *err);

/* The same, where parameters whose names begin with `own` keep their values: a file does not hold them. */
hada_status hada_net_read_but(hada_net *net, const hada_tensors *file, const char *prefix, const char *own,
                              hada_error *err);

/* A net from its description and the tensors of a file. */
hada_status hada_net_from_file(hada_net **out, const char *description, const hada_tensors *file, const char *prefix,
                               hada_error *err);

/* Two halves of writing: the tensors in the order of the table, then their data in the same order. */
hada_status hada_net_declare(const hada_net *net, hada_tensors_writer *writer, const char *prefix, hada_error *err);
hada_status hada_net_write(const hada_net *net, hada_tensors_writer *writer, hada_error *err);

#endif
