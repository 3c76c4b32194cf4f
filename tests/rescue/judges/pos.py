import sys,math,collections
first={};true={};n=collections.Counter();E=collections.defaultdict(list);step=[];last={}
for l in open(sys.argv[1]):
    w=l.split()
    if not w: continue
    if w[0]=='P': true[w[1]]=tuple(map(float,w[3:6]))
    elif w[0]=='E' and w[3]=='Log' and ' B ' in l:
        i=w.index('B');b=tuple(map(float,w[i+1:i+4]));t=true[w[1]]
        if w[1] not in first: first[w[1]]=(b,t)
        b0,t0=first[w[1]];r=b0[2]-t0[2]
        dx,dy=t[0]-t0[0],t[1]-t0[1]
        ex=b0[0]+math.cos(r)*dx-math.sin(r)*dy-b[0];ey=b0[1]+math.sin(r)*dx+math.cos(r)*dy-b[1]
        h=math.degrees((b[2]-b0[2]-t[2]+t0[2]+math.pi)%(2*math.pi)-math.pi)
        e=math.hypot(ex,ey);n[w[1]]+=1
        E[min(n[w[1]]//4,4)].append((e,abs(h)))
for k in sorted(E):
    v=sorted(x[0] for x in E[k]);h=sorted(x[1] for x in E[k])
    print('searches %d-%d: n %d pos err med %.2f p80 %.2f p90 %.2f; heading med %.0f p80 %.0f p90 %.0f'%(4*k,4*k+3,len(v),v[len(v)//2],v[int(len(v)*.8)],v[int(len(v)*.9)],h[len(h)//2],h[int(len(h)*.8)],h[int(len(h)*.9)]))
