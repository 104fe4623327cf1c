// Asio's and Beast's own code, compiled once: server.cpp is slow enough to compile without it.
#include <boost/asio/impl/src.hpp>
#include <boost/asio/ssl/impl/src.hpp>
#include <boost/beast/src.hpp>
