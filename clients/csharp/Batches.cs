// Touches and telemetry in bytes, little-endian: the layout stands in docs/clients.md.
namespace Haptix
{
    using System;
    using System.Collections.Generic;
    using System.IO;

    public enum TouchKind { Down, Move, Up }

    /// <summary>One report of one finger, in millimetres or in pixels of `Session.Geometry`.</summary>
    public struct TouchReport
    {
        /// <summary>Time of `Session.NowS`.</summary>
        public double TimeS;
        /// <summary>The same from down to up, 0 to 255.</summary>
        public int TouchId;
        public TouchKind Kind;
        public bool InPixels;
        public float X, Y;
        /// <summary>Null where nothing measures it.</summary>
        public float? NormalForceN, ContactAreaM2;
        public bool Coalesced;
    }

    /// <summary>Rows of one stream, for one finger; NaN where nothing is known.</summary>
    public sealed class Frame
    {
        public string Stream;
        public int TouchId, Columns;
        public uint Number, Dropped;
        /// <summary>Of the first row by the service's clock, and between rows.</summary>
        public double T0S, StepS;
        /// <summary>Row after row, `Columns` numbers each.</summary>
        public float[] Rows;
        /// <summary>Names of the columns.</summary>
        public string[] Names = new string[0];
    }

    public static class Batches
    {
        static readonly string[] Streams = { "stats", "friction", "felt" };

        /// <summary>Return a batch; its number rises by one.</summary>
        public static byte[] Write(IList<TouchReport> touches, uint number)
        {
            var bytes = new byte[16 + 24 * touches.Count];
            double baseS = touches.Count > 0 ? touches[0].TimeS : 0.0;
            using (var writer = new BinaryWriter(new MemoryStream(bytes))) // always little-endian
            {
                writer.Write((byte)1);
                writer.Write((byte)1);
                writer.Write((ushort)touches.Count);
                writer.Write(number);
                writer.Write(baseS);
                foreach (TouchReport touch in touches)
                {
                    int flags = (int)touch.Kind | (touch.InPixels ? 4 : 0);
                    flags |= (touch.NormalForceN.HasValue ? 8 : 0) | (touch.ContactAreaM2.HasValue ? 16 : 0);
                    writer.Write(checked((int)Math.Round((touch.TimeS - baseS) * 1e6)));
                    writer.Write(checked((byte)touch.TouchId));
                    writer.Write((byte)(flags | (touch.Coalesced ? 32 : 0)));
                    writer.Write((ushort)0);
                    writer.Write(touch.X);
                    writer.Write(touch.Y);
                    writer.Write(touch.NormalForceN ?? 0f);
                    writer.Write(touch.ContactAreaM2 ?? 0f);
                }
            }
            return bytes;
        }

        /// <summary>Return the frame of telemetry that some bytes hold.</summary>
        public static Frame Read(byte[] bytes)
        {
            if (bytes.Length < 32 || bytes[0] != 2 || bytes[1] < 1 || bytes[1] > Streams.Length)
                throw new FormatException("expected a frame of telemetry, got " + bytes.Length + " bytes");
            using (var reader = new BinaryReader(new MemoryStream(bytes)))
            {
                reader.ReadByte();
                var frame = new Frame { Stream = Streams[reader.ReadByte() - 1] };
                frame.TouchId = reader.ReadByte();
                frame.Columns = reader.ReadByte();
                int count = frame.Columns * reader.ReadUInt16();
                if (bytes.Length != 32 + 4 * count)
                    throw new FormatException(count + " numbers do not take " + bytes.Length + " bytes");
                reader.ReadUInt16();
                frame.Number = reader.ReadUInt32();
                frame.Dropped = reader.ReadUInt32();
                frame.T0S = reader.ReadDouble();
                frame.StepS = reader.ReadDouble();
                frame.Rows = new float[count];
                for (int i = 0; i < count; i++) frame.Rows[i] = reader.ReadSingle();
                return frame;
            }
        }
    }
}
